"""Scoring amodal masks beside pycocotools alone on the same masks; the numbers must be equal.

    python benchmarks/evaluate/amodal.py [--images 500] [--instances 12] [--draws 2000]

Made-up stacks of discs, 640 x 480. CPU seconds with child processes.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from legoworld.evaluation.detection.evaluate import evaluate_detections
from legoworld.evaluation.family import EvaluationRequest
from legoworld.evaluation.run import read_run
from legoworld.tracks.vocabulary import from_json

SIZE_WH = (640, 480)


def main() -> int:
    """Time both; see the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=500)
    parser.add_argument("--instances", type=int, default=12)
    parser.add_argument("--draws", type=int, default=2000)
    args = parser.parse_args()
    truth = made_truth(args.images, args.instances, seed=0)
    shifted = made_truth(args.images, args.instances, seed=0, shift=4)["annotations"]
    keys = ("image_id", "category_id", "segmentation", "visible_mask")
    scores = np.random.default_rng(1).permutation(len(shifted)) / len(shifted)
    predictions = [{**{k: a[k] for k in keys}, "score": float(s)}
                   for a, s in zip(shifted, scores, strict=True)]  # fmt: skip
    print(f"{args.images} images, {len(predictions)} predictions")
    begin = time.process_time()
    official = pycocotools(truth, predictions)
    print(f"    pycocotools  {time.process_time() - begin:7.2f} CPU s")
    with tempfile.TemporaryDirectory() as folder:
        run, file = Path(folder, "run"), Path(folder, "truth.json")
        write_run(run, truth, predictions)
        file.write_text(json.dumps(truth))
        begin = time.process_time()
        request = EvaluationRequest(
            run=read_run(run), truth=file, output=Path(folder, "e"), draws=args.draws
        )
        summary = evaluate_detections(request)
        print(f"    evaluate     {time.process_time() - begin:7.2f} CPU s")
    if list(summary.official) != official:
        raise SystemExit("the numbers differ")
    assert summary.amodal
    print(f"    AP {summary.metrics['AP']:.4f}, {dict(summary.amodal.metrics)}")
    return 0


def made_truth(images: int, instances: int, *, seed: int, shift: int = 0) -> dict:
    """Discs, each in front of those after it, all moved by `shift` pixels."""
    random, annotations = np.random.default_rng(seed), []
    for image_id in range(1, images + 1):
        taken = np.zeros(SIZE_WH[::-1], np.uint8)
        for _ in range(instances):
            disc = np.zeros_like(taken)
            centre = [int(v) + shift for v in random.integers((0, 0), SIZE_WH)]
            cv2.circle(disc, centre, int(random.integers(20, 120)), 1, -1)
            annotations.append({
                "id": len(annotations) + 1, "image_id": image_id, "iscrowd": 0,
                "category_id": int(random.integers(1, 11)), "bbox": [0, 0, *SIZE_WH],
                "area": int(disc.sum()), "segmentation": encoded(disc),
                "visible_mask": encoded(disc & ~taken),
            })  # fmt: skip
            taken |= disc
    size = dict(zip(("width", "height"), SIZE_WH, strict=True))
    return {
        "images": [{"id": i, "file_name": f"{i}.jpg", **size} for i in range(1, images + 1)],
        "annotations": annotations,
        "categories": [{"id": k, "name": f"thing {k}"} for k in range(1, 11)],
    }


def encoded(mask: np.ndarray) -> dict:
    made = coco_mask.encode(np.asfortranarray(mask, np.uint8))
    return {"size": made["size"], "counts": made["counts"].decode()}


def pycocotools(truth: dict, predictions: list[dict]) -> list[float]:
    with contextlib.redirect_stdout(io.StringIO()):
        true = COCO()
        true.dataset = json.loads(json.dumps(truth))
        true.createIndex()
        evaluation = COCOeval(true, true.loadRes(json.loads(json.dumps(predictions))), "segm")
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return evaluation.stats.tolist()


def write_run(folder: Path, truth: dict, predictions: list[dict]) -> None:
    folder.mkdir()
    sha256 = from_json(truth["categories"], "truth").sha256
    configuration = {"task": "amodal", "kind": "", "attempted": len(truth["images"]),
                     "partial": False, "vocabulary_sha256": sha256}  # fmt: skip
    rows = [{"image_id": i["id"], "file_name": i["file_name"], "size_wh": SIZE_WH, "status": "ok"}
            for i in truth["images"]]  # fmt: skip
    (folder / "run.json").write_text(json.dumps({"configuration": configuration}))
    (folder / "per_image.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    (folder / "predictions.json").write_text(json.dumps(predictions))


if __name__ == "__main__":
    raise SystemExit(main())
