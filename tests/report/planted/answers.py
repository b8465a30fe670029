"""Faults of label maps, relations and reconstructions."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from evaluation.panoptic import official_rule
from evaluation.panoptic.panoptic_files import call, scored, write_panoptic
from evaluation.reconstruction.datasets import POSE, VALID, Submission
from evaluation.relations.folders import STREET, TABLE, evaluated, write_facts
from msgspec.structs import replace
from PIL import Image
from report.bench_pages import EMPTY, bench_dataset, bench_evaluation
from report.planted.plant import Plant, Planted

Array = np.ndarray
PERSON, CAR, SKY, WALL = 1, 3, 187, 199
NAMES = {PERSON: "person", CAR: "car", SKY: "sky-other-merged", WALL: "wall-other-merged"}
IMAGES, HIGH, WIDE = 6, 48, 64


def cells(random: np.random.Generator) -> dict[int, tuple[slice, slice, int]]:
    """Segments by id: six cells with a border, of categories that all occur."""
    kinds = [PERSON, CAR, *random.choice([PERSON, CAR], 2), SKY, WALL]
    return {
        k + 1: (slice(24 * (k // 3) + 2, 24 * (k // 3) + 22),
                slice(21 * (k % 3), 21 * (k % 3) + 20), int(kind))
        for k, kind in enumerate(random.permutation(kinds).tolist())
    }  # fmt: skip


def painted(segments: dict[int, tuple[slice, slice, int]]) -> Any:
    ids = np.zeros((HIGH, WIDE), np.int64)
    for number, (rows, cols, _) in segments.items():
        ids[rows, cols] = number
    return ids, [(number, kind, 0) for number, (_, _, kind) in segments.items()]


def panoptic(fault: str, folder: Path, random: np.random.Generator) -> Planted:
    truth = {image: cells(random) for image in range(1, IMAGES + 1)}
    category = int(random.choice([PERSON, CAR]))
    bad, mended = ({i: dict(s) for i, s in truth.items()} for _ in range(2))
    hit = sorted(random.choice([*truth], 3, replace=False).tolist())
    gone: set[int] = set()
    for image in hit:
        number = next(n for n, (*_, kind) in truth[image].items() if kind == category)
        rows, cols, _ = truth[image][number]
        if fault == "missed":
            del bad[image][number]
        elif fault == "loose":
            bad[image][number] = (slice(rows.start, rows.stop - 7), cols, category)
        elif fault == "false":
            wall, (rows, cols, _) = next(x for x in truth[image].items() if x[1][2] == WALL)
            bad[image][9] = (slice(rows.start, rows.start + 5), cols, category)
            for sets in (bad, mended):  # the wall stays as small without it
                sets[image][wall] = (slice(rows.start + 5, rows.stop), cols, WALL)
        else:
            gone.add(image)
    kind, says = fault, (NAMES[category],)
    for at, sets in (("mended", mended), ("bad", bad)):
        (folder / at).mkdir(parents=True)
        pictures = {i: painted(s) for i, s in sets.items()}
        write_panoptic(folder / at / "theirs.json", pictures, truth=False)
    every = {i: painted(s) for i, s in truth.items()}
    path = write_panoptic(folder / "truth.json", every)
    quality = official_rule.quality
    size = quality(path, folder / "mended/theirs.json")["PQ"]
    if gone:
        kind, says = "failed", ("3 of 6 images without",)
        shown = {i: painted(s) for i, s in bad.items() if i not in gone}
        write_panoptic(folder / "bad/theirs.json", shown, truth=False)
        empty = shown | {i: (np.zeros((HIGH, WIDE), np.int64), []) for i in gone}
        write_panoptic(folder / "bad/void.json", empty, truth=False)
        size -= quality(path, folder / "bad/void.json")["PQ"]
    else:
        size -= quality(path, folder / "bad/theirs.json")["PQ"]
    scored(folder, path, folder / "bad/theirs.json", code=int(bool(gone)))
    return Planted(evaluations=(folder / "eval",), kind=kind, says=says, size=size,
                   images=frozenset(hit))  # fmt: skip


def miou(truth: Sequence[Array], answers: Sequence[Array], ids: Sequence[int]) -> float:
    """Mean IoU over the classes that occur; 0 has no class."""
    true, given = np.concatenate(truth).ravel(), np.concatenate(answers).ravel()
    true, given = true[true > 0], given[true > 0]
    both = [np.sum((true == c) & (given == c)) for c in ids]
    either = [np.sum((true == c) | (given == c)) for c in ids]
    return float(np.mean([b / e for b, e in zip(both, either, strict=True) if e]))


def semantic(fault: str, folder: Path, random: np.random.Generator) -> Planted:
    ids = sorted(random.choice(np.arange(1, 151), 4, replace=False).tolist())
    blocks = random.choice(ids, (IMAGES, 6, 8))
    blocks[:, 0, :4] = ids
    truth = [np.kron(b, np.ones((8, 8), int)) for b in blocks]
    category = int(random.choice(ids))
    bad = [t.copy() for t in truth]
    hit = sorted(random.choice(IMAGES, 3, replace=False).tolist())
    for at in hit:
        own = truth[at] == category
        if fault == "missed":
            bad[at][own] = 0
        elif fault == "false":  # truth of no class is not scored: a fault in truth and answer
            other = next(c for c in ids if c != category)
            bad[at][truth[at] == other] = category
    mended = [t.copy() for t in truth]
    if fault == "false":
        for at in hit:
            mended[at][bad[at] != truth[at]] = 0
    for k, (true, given) in enumerate(zip(truth, bad, strict=True)):
        for name, values in (("photos", true * 0), ("truth", true), ("theirs", given)):
            if name == "theirs" and fault == "absent" and k in hit:
                continue
            path = folder / name / f"{k}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(values.astype(np.uint8)).save(path)
    kind, says = fault, (":",)
    if fault == "absent":
        kind, says = "failed", ("3 of 6 images without",)
        bad = [b * 0 if k in hit else b for k, b in enumerate(bad)]
    size = miou(truth, mended, ids) - miou(truth, bad, ids)
    task = ("--task", "ade20k-semantic")
    photos = ("--photos", folder / "photos", "-o", folder / "track.json")
    call("track", "make", *task, "--truth", folder / "truth", *photos)
    where = (*task, "--track", folder / "track.json", "-o", folder / "run")
    call("baseline", "import", "-q", folder / "theirs", *where, code=int(fault == "absent"))
    words = ("--truth", folder / "truth", "-o", folder / "eval", "--draws", 20)
    call("evaluate", "-q", folder / "run", *words)
    return Planted(evaluations=(folder / "eval",), kind=kind, says=says, size=size,
                   images=frozenset(k + 1 for k in hit))  # fmt: skip


def relations(fault: str, folder: Path, random: np.random.Generator) -> Planted:
    """Scenes that are mirrored, or not there."""
    truth = {f"{k}.jpg": (TABLE, STREET)[k % 2] for k in range(4)}
    at = int(random.integers(4))
    shown: dict[str, Any] = dict(truth)
    turned = tuple((n, (-x, y, z), size) for n, (x, y, z), size in truth[f"{at}.jpg"])
    shown[f"{at}.jpg"] = None if fault == "absent" else turned
    with contextlib.redirect_stdout(io.StringIO()):
        run = write_facts(folder / "run", shown)
        summary = evaluated(run, write_facts(folder / "truth", truth), folder / "eval")
    every = summary["metrics"]["accuracy"]
    images = frozenset({at + 1})
    if fault == "absent":
        says, size = ("1 of 4 images without scene",), 1 - every["answers"]
        return Planted(evaluations=(folder / "eval",), kind="failed", says=says, size=size,
                       images=images)  # fmt: skip
    wrong = {name: m["n"] * (1 - m["answers"]) for name, m in summary["relations"].items()}
    worst = max(wrong, key=lambda name: wrong[name])
    return Planted(evaluations=(folder / "eval",), kind="relation", says=(worst,),
                   size=wrong[worst] / every["n"], images=images)  # fmt: skip


def bench(fault: Callable[..., Any], folder: Path, random: np.random.Generator) -> Planted:
    dataset = bench_dataset(folder)
    at = int(random.choice([*dataset.cases]))
    case = dataset.cases[at]
    submission, metric, kind, says, *advice = fault(case, random)
    bad = bench_evaluation(folder, dataset, "bad", {at: submission})
    value = json.loads((bad / "summary.json").read_text())["metrics"][metric]["value"]
    return Planted(evaluations=(bad,), kind=kind, says=says, size=1 - value, metric=metric,
                   images=frozenset({at}), advice=dict.fromkeys([at] * len(advice), *advice[:1]),
                   )  # fmt: skip


def moved_ball(case: Any, random: np.random.Generator) -> Any:
    depth = case.depth_z_m.copy()
    ball = int(random.choice(sorted({*np.unique(case.instance)} - {-1, 0})))
    depth[case.instance == ball] *= 1.35
    return Submission(depth_z_m=depth), "R", "object", ("ball: 1 object",)


def far_away(case: Any, random: np.random.Generator) -> Any:
    """The whole scene half as large again."""
    found = Submission(depth_z_m=case.depth_z_m * random.uniform(1.4, 1.6))
    return found, "R", "object", ("ball: ",)


def upside_down(case: Any, random: np.random.Generator) -> Any:
    """The camera is turned about its axis: registration does not find that, its pose says it."""
    pose = ((-1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0, 0.0), *POSE[2:])
    found = Submission(depth_z_m=np.ascontiguousarray(case.depth_z_m[::-1, ::-1]), pose=pose)
    said = "would be 1.000 with the surfaces seen from the reference camera's pose, 180.0 degrees"
    return found, "R", "object", ("ball: ",), said


def painted_room(case: Any, random: np.random.Generator) -> Any:
    balls = cv2.dilate((case.instance > 0).astype(np.float32), np.ones((5, 5)))
    room = cv2.resize(balls, case.render.shape[1::-1], interpolation=cv2.INTER_AREA) == 0
    room[int(random.integers(3, 6)) :] = False
    render = np.where(room[..., None], case.render ^ 128, case.render)
    return Submission(render=render), "A", "object", ("around",)


def invalid(case: Any, random: np.random.Generator) -> Any:
    found = Submission(validity=replace(VALID, scene_glb=EMPTY))
    return found, "R", "failed", ("1 of 8 cases without valid submission",)


def failed(case: Any, random: np.random.Generator) -> Any:
    return Submission(status="failed"), "A", "failed", ("1 of 8 cases",)


_MAPS = {"missed": "a missed class", "false": "an invented class", "absent": "missing answers"}
PLANTS = (
    *(Plant("coco-panoptic", name, partial(panoptic, f)) for f, name in _MAPS.items()),
    Plant("coco-panoptic", "loose segments", partial(panoptic, "loose")),
    *(Plant("ade20k-semantic", name, partial(semantic, f)) for f, name in _MAPS.items()),
    Plant("relations", "a mirrored scene", partial(relations, "mirrored")),
    Plant("relations", "a missing scene", partial(relations, "absent")),
    Plant("bench", "a moved object", partial(bench, moved_ball)),
    Plant("bench", "wrong scale", partial(bench, far_away)),
    Plant("bench", "moved camera", partial(bench, upside_down)),
    Plant("bench", "another colour", partial(bench, painted_room)),
    Plant("bench", "not valid", partial(bench, invalid)),
    Plant("bench", "failed", partial(bench, failed)),
)
