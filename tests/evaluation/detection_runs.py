"""Run folders and truths made for tests: small, random, with every kind of trouble in them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pycocotools import mask as coco_mask

from legoworld.evaluation.detection import evaluate as detection_evaluate
from legoworld.evaluation.detection.inputs.prediction_checks import as_predictions
from legoworld.evaluation.detection.inputs.prediction_order import canonical_key
from legoworld.evaluation.detection.inputs.predictions import check_predictions, prediction_type
from legoworld.evaluation.detection.inputs.truth import read_truth
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.family import EvaluationRequest
from legoworld.evaluation.run import read_run
from legoworld.records.base import to_record
from legoworld.records.predictions import Prediction
from legoworld.tracks.vocabulary import from_json

Document = dict[str, Any]


def evaluate_detections(run: Path, truth: Path, output: Path, **request: Any) -> Any:
    """`evaluate` of a run of boxes or masks into a folder. request: of `EvaluationRequest`."""
    options = {"evaluator": request.pop("evaluator", None)}
    given = {"draws": 2000, **request}
    return detection_evaluate.evaluate_detections(
        EvaluationRequest(run=read_run(run), truth=truth, output=output, options=options, **given)
    )


def random_truth(
    task: str, *, seed: int, images: int = 12, categories: int = 6, per_image: int = 5
) -> Document:
    """A truth with crowds (COCO) or unverified and partly annotated categories (LVIS)."""
    random = np.random.default_rng(seed)
    document: Document = {
        "images": [
            {"id": 10 + 3 * i, "file_name": f"{i:03}.jpg", "width": 120, "height": 90}
            for i in range(images)
        ],
        "annotations": [],
        "categories": [
            {"id": 5 + 2 * k, "name": f"thing {k}", "frequency": "rcf"[k % 3]}
            for k in range(categories)
        ],
    }
    ids = [c["id"] for c in document["categories"]]
    for image in document["images"]:
        if task == "lvis":
            image["neg_category_ids"] = random.choice(ids, 2, replace=False).tolist()
            image["not_exhaustive_category_ids"] = random.choice(ids, 1).tolist()
        for _ in range(random.integers(0, per_image + 1)):
            box, mask = random_shape(random)
            annotation = {
                "id": len(document["annotations"]) + 1,
                "image_id": image["id"],
                "category_id": int(random.choice(ids)),
                "bbox": box,
                "area": float(coco_mask.area(mask)),
                "segmentation": text_counts(mask),
            }
            if task != "lvis":
                annotation["iscrowd"] = int(random.random() < 0.15)
            document["annotations"].append(annotation)
    return document


def random_predictions(
    task: str, truth: Document, *, seed: int, per_image: int = 9, levels: int | None = None
) -> list[dict[str, Any]]:
    """Predictions near and far from the truth. levels: distinct scores (None: all distinct)."""
    random = np.random.default_rng(seed)
    ids = [c["id"] for c in truth["categories"]]
    by_image: dict[int, list[Document]] = {}
    for a in truth["annotations"]:
        by_image.setdefault(a["image_id"], []).append(a)
    found = []
    for image in truth["images"]:
        for _ in range(per_image):
            mine = by_image.get(image["id"], [])
            box, mask = random_shape(random)
            category = int(random.choice(ids))
            if mine and random.random() < 0.6:
                true = mine[random.integers(len(mine))]
                category = true["category_id"] if random.random() < 0.8 else category
                box, mask = moved(true["bbox"], random)
            entry: dict[str, Any] = {"image_id": image["id"], "category_id": category}
            if task == "coco":
                entry["bbox"] = box
            else:
                entry["segmentation"] = text_counts(mask)
            found.append(entry)
    scores = (
        random.permutation(len(found)) if levels is None else random.integers(0, levels, len(found))
    )
    for entry, score in zip(found, scores, strict=True):
        entry["score"] = float(score + 1) / (len(found) + 1)
    return found


def random_shape(random: np.random.Generator) -> tuple[list[int], Document]:
    """A filled box of 3 to 60 pixels inside 120 x 90, and its mask."""
    w, h = (int(v) for v in random.integers(3, [60, 50]))
    x, y = int(random.integers(0, 120 - w + 1)), int(random.integers(0, 90 - h + 1))
    return [x, y, w, h], box_mask([x, y, w, h])


def moved(box: Sequence[float], random: np.random.Generator) -> tuple[list[int], Document]:
    """The box with its edges moved by a pixel or more, inside 120 x 90."""
    x, y, w, h = (int(v) for v in box)
    dx, dy = (int(v) for v in random.integers(-2, 3, 2))
    x, y = min(max(x + dx, 0), 120 - w), min(max(y + dy, 0), 90 - h)
    return [x, y, w, h], box_mask([x, y, w, h])


def box_mask(box: Sequence[int]) -> Document:
    """The compressed mask of a box in 120 x 90."""
    x, y, w, h = box
    mask = np.zeros((90, 120), np.uint8, order="F")
    mask[y : y + h, x : x + w] = 1
    return coco_mask.encode(mask)


def text_counts(mask: Document) -> Document:
    return {"size": list(mask["size"]), "counts": mask["counts"].decode("ascii")}


def write_run(
    folder: Path,
    task: str,
    truth: Document,
    predictions: Sequence[Mapping[str, Any]],
    *,
    statuses: Mapping[int, str] | None = None,
    **configuration: Any,
) -> Path:
    """A finished run folder over all the truth's images."""
    folder.mkdir(parents=True, exist_ok=True)
    document = {
        "configuration": {
            "task": task,
            "kind": "scene",
            "attempted": len(truth["images"]),
            "partial": False,
            "vocabulary_sha256": from_json(truth["categories"], "truth").sha256,
            **configuration,
        }
    }
    rows = [
        {
            "image_id": i["id"],
            "file_name": Path(i.get("coco_url", i["file_name"])).name,
            "size_wh": [i["width"], i["height"]],
            "status": (statuses or {}).get(i["id"], "ok"),
        }
        for i in truth["images"]
    ]
    (folder / "run.json").write_text(json.dumps(document))
    (folder / "per_image.jsonl").write_text("".join(json.dumps(r) + "\n" for r in rows))
    (folder / "predictions.json").write_text(json.dumps(list(predictions)))
    return folder


def write_truth(path: Path, truth: Document) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(truth))
    return path


def checked(folder: Path, task: str, truth: Document, predictions: Sequence[Any], **options: Any):
    """(protocol, truth, predictions) as scoring sees them."""
    protocol = detection_protocol(task)
    run = read_run(write_run(folder / "run", task, truth, predictions, **options))
    read = read_truth(write_truth(folder / "truth.json", truth), protocol, run)
    batches = [as_predictions(predictions, prediction_type(protocol))]
    return protocol, read, check_predictions(batches, run=run, truth=read, protocol=protocol)


def by_canonical_key(entry: Document) -> tuple[Any, ...]:
    """`canonical_key` of a result as JSON has it."""
    return canonical_key(to_record(Prediction, entry))


def match_everything(protocol: Any, truth: Any, predictions: Any):
    """(problem, match table)."""
    from legoworld.evaluation.detection.matching.matches import match_states
    from legoworld.evaluation.detection.matching.outcomes import match_table
    from legoworld.evaluation.detection.problem import build_problem

    problem = build_problem(truth, predictions, protocol)
    return problem, match_table(problem, match_states(problem, truth, predictions))


def read_rows(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").split("\n") if line]
