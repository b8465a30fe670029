"""Evaluation folders to compare, made by evaluate itself from small constructed runs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from evaluation.depth.folders import evaluate_depth, plane, write_arrays
from evaluation.depth.folders import write_run as write_depth_run
from evaluation.detection_runs import (
    evaluate_detections,
    random_predictions,
    random_truth,
    write_run,
    write_truth,
)
from numpy.typing import NDArray

from legoworld.comparison.make_comparison import make_comparison
from legoworld.evaluation.checks import Check
from legoworld.evaluation.detection.evaluators import EvaluatorKind
from legoworld.files import sha256_of_file
from legoworld.records.base import canonical
from legoworld.records.comparison import ComparisonSettings

SIZE_WH = (40, 30)
DEPTH_NAMES = ("a/images/dslr_images/1.JPG", "a/images/dslr_images/2.JPG",
               "b/images/dslr_images/1.JPG", "b/images/dslr_images/2.JPG",
               "c/images/dslr_images/1.JPG")  # fmt: skip


def evaluate(
    folder: Path,
    task: str,
    truth: dict[str, Any],
    predictions: Sequence[Mapping[str, Any]],
    *,
    statuses: Mapping[int, str] | None = None,
    evaluator: EvaluatorKind = "official",
    scenes: Mapping[str, Any] | None = None,
    **configuration: Any,
) -> Path:
    """The evaluation of a detection run; predictions of images with a status are left out."""
    left = [p for p in predictions if p["image_id"] not in (statuses or {})]
    run = write_run(folder / "run", task, truth, left, statuses=statuses, **configuration)
    if scenes is not None:
        document = json.loads((run / "run.json").read_text())
        (run / "run.json").write_text(json.dumps({**document, "scenes": scenes}))
    path = write_truth(folder / "truth.json", truth)
    evaluate_detections(run, path, folder / "eval", evaluator=evaluator, draws=20)
    return folder / "eval"


def scene_and_baseline(folder: Path, task: str, *, seed: int = 1) -> tuple[Path, Path]:
    """A scene's evaluation, two images missing, and that of a ranked baseline, one failed."""
    truth = random_truth(task, seed=seed)
    ids = [i["id"] for i in truth["images"]]
    with_truth = sorted({a["image_id"] for a in truth["annotations"]})
    scene = [
        {**p, "score": 1.0} for p in random_predictions(task, truth, seed=seed + 1, per_image=5)
    ]
    baseline = random_predictions(task, truth, seed=seed + 2)
    return (
        evaluate(folder / "scene", task, truth, scene,
                  statuses={with_truth[0]: "missing", ids[-1]: "timeout"}),
        evaluate(folder / "baseline", task, truth, baseline, statuses={with_truth[1]: "failed"},
                  kind="baseline", baseline="specialist"),
    )  # fmt: skip


def depth_truth() -> dict[str, NDArray[np.float64]]:
    """Five photos of three ETH3D scenes; the last has next to no valid truth."""
    truth = {name: plane(SIZE_WH, seed=k) for k, name in enumerate(DEPTH_NAMES)}
    truth[DEPTH_NAMES[4]] = np.full(SIZE_WH[::-1], np.inf)
    truth[DEPTH_NAMES[4]][0, :3] = 2.0
    return truth


def depth_prediction(noise: float, seed: int) -> dict[str, Any]:
    """Noisy depth of every photo, a few holes in each."""
    random = np.random.default_rng(seed)
    found: dict[str, Any] = {}
    for k, name in enumerate(DEPTH_NAMES):
        z = plane(SIZE_WH, seed=k) * random.uniform(1, 1 + noise, SIZE_WH[::-1])
        z[:2, :7] = np.inf
        found[name] = z
    return found


def evaluated_depth(folder: Path, predictions: Mapping[str, Any], **run: Any) -> Path:
    """The evaluation of a depth run over `depth_truth`."""
    truth = write_arrays(folder / "truth", depth_truth())
    camera_model = run.pop("camera_model", "none")
    made = write_depth_run(folder / "run", dict(predictions), size_wh=SIZE_WH, **run)
    evaluate_depth(made, truth, folder / "eval", camera_model=camera_model, draws=20)
    return folder / "eval"


def depth_scene_and_baseline(folder: Path) -> tuple[Path, Path]:
    """A scene's depth, one photo missing, one failed; and a baseline's, which is better."""
    scene = {**depth_prediction(0.6, seed=1), DEPTH_NAMES[1]: "missing", DEPTH_NAMES[4]: "failed"}
    baseline = depth_prediction(0.2, seed=2)
    return (
        evaluated_depth(folder / "scene", scene),
        evaluated_depth(folder / "baseline", baseline, kind="baseline"),
    )


def compare(
    evaluations: Sequence[Path], output: Path, *, draws: int = 60, seed: int = 0, **options: Any
) -> dict[str, Any]:
    """The document of a comparison, as its file holds it."""
    allow = options.pop("allow_truth_prompts", False)
    settings = ComparisonSettings(draws=draws, seed=seed, allow_truth_prompts=allow)
    document, _ = make_comparison(evaluations, output, settings, **options)
    return json.loads(canonical(document))


def row_of(document: dict[str, Any], metric: str, images: str, pair: int = 0) -> dict[str, Any]:
    """One row of a comparison."""
    rows = document["pairs"][pair]["rows"]
    (found,) = [r for r in rows if (r["metric"], r["images"]) == (metric, images)]
    return found


def change_json(path: Path, change: Any) -> None:
    """Edit a JSON file in place."""
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def forge(folder: Path, name: str, change: Callable[[Path], object]) -> None:
    """Change a file and put its new hash on record: only the numbers can tell."""
    change(folder / name)
    digest = sha256_of_file(folder / name)
    change_json(folder / "evidence.json", lambda e: e["files"].update({name: digest}))


def bad(checks: Sequence[Check]) -> list[Check]:
    """The checks that do not hold."""
    return [c for c in checks if c.status != "ok"]
