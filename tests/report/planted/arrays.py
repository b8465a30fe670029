"""Faults of depth and normals: known regions of known error, recomputed in plain NumPy."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from evaluation.depth.folders import evaluate_depth, write_arrays
from evaluation.depth.folders import write_run as write_depth_run
from evaluation.normals.folders import evaluate as evaluate_normals
from evaluation.normals.folders import write_run as write_normals_run
from evaluation.normals.folders import write_truth as write_normals
from report.planted.plant import Plant, Planted

Array = np.ndarray
SIZE_WH = (96, 72)
IMAGES = 6
#: A block of a photo, by where it is said to be.
PLACES = {"upper left": np.s_[5:25, 4:30], "in the middle": np.s_[26:46, 34:62],
          "lower right": np.s_[48:70, 66:92]}  # fmt: skip


def abs_rel(truth: Array, predicted: Array) -> float:
    """Least squares in disparity, floored at the deepest truth; a hole is an error of 1."""
    known = np.isfinite(predicted)
    x, y = 1 / predicted[known], 1 / truth[known]
    scale, shift = np.polyfit(x, y, 1)
    aligned = 1 / np.maximum(scale * x + shift, 1 / truth.max())
    error = np.ones(truth.shape)
    error[known] = np.abs(aligned - truth[known]) / truth[known]
    return float(error.mean())


def mean_deg(truth: Array, predicted: Array) -> float:
    """A hole is an error of 90 degrees."""
    cosines = np.clip((truth * predicted).sum(axis=-1), -1, 1)
    return float(np.where(np.isfinite(cosines), np.degrees(np.arccos(cosines)), 90).mean())


def smooth(random: np.random.Generator) -> Array:
    """(H, W), without a direction or a period, about 0."""
    noise = cv2.GaussianBlur(random.normal(size=SIZE_WH[::-1]), (0, 0), 5)
    made: Array = noise / noise.std()
    return made


def depth(random: np.random.Generator) -> tuple[Array, Array]:
    truth = np.exp(0.25 * smooth(random)) * random.uniform(2, 6)
    return truth, 1.4 * truth * (1 + 0.004 * random.normal(size=truth.shape))


def normals(random: np.random.Generator) -> tuple[Array, Array]:
    slopes = np.stack([0.4 * smooth(random), 0.4 * smooth(random), -np.ones(SIZE_WH[::-1])], -1)
    truth = slopes / np.linalg.norm(slopes, axis=-1, keepdims=True)
    return truth, turned(truth, 1.0)


def turned(vectors: Array, degrees: float) -> Array:
    """About the vertical axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return vectors @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T


def faulty(
    kind: str, fault: Callable[..., Any], folder: Path, random: np.random.Generator
) -> Planted:
    made, score = (depth, abs_rel) if kind == "eth3d" else (normals, mean_deg)
    pairs = {f"{k}.png": made(random) for k in range(IMAGES)}
    truth = {name: pair[0] for name, pair in pairs.items()}
    bad = {name: pair[1].copy() for name, pair in pairs.items()}
    at = int(random.integers(IMAGES))
    name = f"{at}.png"
    told, says, mended = fault(truth[name], bad[name], random)
    before = score(truth[name], bad[name])
    size = (score(truth[name], mended) - before) / IMAGES
    where = folder / kind
    if told == "failed":
        shown: dict[str, Any] = dict(bad)
        shown[name] = "failed" if kind == "eth3d" else np.empty(0)
        rest = [score(truth[n], p) for n, p in bad.items() if n != name]
        size = np.mean(rest) - np.mean([*rest, 1.0 if kind == "eth3d" else 90.0])
    else:
        shown, says = bad, (name, *says) if told != "holes" else says
    if kind == "eth3d":
        run = write_depth_run(where / "run", shown)
        evaluate_depth(run, write_arrays(where / "truth", truth), where / "eval", draws=20)
    else:
        run = write_normals_run(where / "run", shown)
        evaluate_normals(run, write_normals(where / "truth", truth), where / "eval")
    return Planted(
        evaluations=(where / "eval",), kind=told, says=says, size=float(size),
        within=0.06 * abs(size), images=frozenset({at + 1}),
    )  # fmt: skip


def _block(truth: Array, bad: Array, random: np.random.Generator, change: Any) -> Any:
    place = str(random.choice(sorted(PLACES)))
    mended = bad.copy()
    bad[PLACES[place]] = change(bad[PLACES[place]])
    return "region", (place,), mended


def nearer(truth: Array, bad: Array, random: np.random.Generator) -> Any:
    kind, says, mended = _block(truth, bad, random, lambda z: 0.55 * z)
    return kind, (*says, "too near"), mended


def farther(truth: Array, bad: Array, random: np.random.Generator) -> Any:
    kind, says, mended = _block(truth, bad, random, lambda z: 1.8 * z)
    return kind, (*says, "too far"), mended


def leaning(truth: Array, bad: Array, random: np.random.Generator) -> Any:
    kind, says, mended = _block(truth, bad, random, lambda n: turned(n, 40))
    return kind, (*says, "degrees off"), mended


def hole(truth: Array, bad: Array, random: np.random.Generator) -> Any:
    _, _, mended = _block(truth, bad, random, lambda z: np.full_like(z, np.nan))
    return "holes", ("nothing",), mended


def camera(truth: Array, bad: Array, random: np.random.Generator) -> Any:
    right, down = (int(v) for v in random.integers(3, 8, 2))
    mended = bad.copy()
    bad[:] = np.roll(bad, (down, right), (0, 1))
    return "camera", (f"{right} px left and {down} px up",), mended


def another(truth: Array, bad: Array, random: np.random.Generator) -> Any:
    """Another scene, or every face turned away: nothing in it is right."""
    bad[:] = np.exp(0.4 * smooth(random)) if bad.ndim == 2 else turned(bad, 55)
    return "photo", ("as a whole",), truth


def lost(truth: Array, bad: Array, random: np.random.Generator) -> Any:
    return "failed", ("1 of 6 images without scene",), bad.copy()


_DEPTH = {
    "an object too near": nearer,
    "an object too far": farther,
    "holes": hole,
    "moved camera": camera,
    "another scene": another,
    "a missing scene": lost,
}
_NORMALS = {
    "a leaning object": leaning,
    "holes": hole,
    "moved camera": camera,
    "all turned": another,
    "a missing scene": lost,
}
PLANTS = tuple(
    Plant(task, name, partial(faulty, task, fault))
    for task, faults in (("eth3d", _DEPTH), ("normals", _NORMALS))
    for name, fault in faults.items()
)
