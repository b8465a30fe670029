"""The official evaluators called directly, and runs scored beside them."""

from __future__ import annotations

import contextlib
import io
import json

import numpy as np
from evaluation.detection_runs import evaluate_detections, write_run, write_truth
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from legoworld.evaluation.detection import lvis_package


def direct_coco(truth_path, results, iou_type="bbox"):
    """pycocotools as its own demo calls it: (stats, printed lines)."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        true = COCO(str(truth_path))
        evaluation = COCOeval(true, true.loadRes(json.loads(json.dumps(results))), iou_type)
        evaluation.evaluate()
        evaluation.accumulate()
        printed.truncate(0)
        printed.seek(0)
        evaluation.summarize()
    return evaluation.stats, printed.getvalue().splitlines()


def direct_lvis(truth_path, results):
    """The lvis package as its own test calls it: (numbers, printed lines)."""
    package = lvis_package.load()
    printed = io.StringIO()
    with lvis_package.quiet(), contextlib.redirect_stdout(printed):
        true = package.LVIS(str(truth_path))
        found = package.LVISResults(true, json.loads(json.dumps(results)))
        evaluation = package.LVISEval(true, found, "segm")
        evaluation.run()
        evaluation.print_results()
    return np.array(list(evaluation.get_results().values())), printed.getvalue().splitlines()


def direct(task):
    """The official evaluator of a task, called directly."""
    if task == "lvis":
        return direct_lvis
    return lambda path, results: direct_coco(path, results, "bbox" if task == "coco" else "segm")


def evaluate(folder, task, truth, predictions, *, statuses=None, whole=None, **options):
    """whole: the truth to score against where it has more than the run's images."""
    run = write_run(folder / "run", task, truth, predictions, statuses=statuses)
    truth_path = write_truth(folder / "truth.json", whole or truth)
    return evaluate_detections(
        run, truth_path, folder / "eval", **{"evaluator": "official", "draws": 20, **options}
    )


def official_with_ids(evaluation, task, image_ids, entries):
    """COCOeval or LVISEval on the whole truth, told which images to look at."""
    truth_path = str(evaluation.parent / "truth.json")
    with contextlib.redirect_stdout(io.StringIO()):
        if task == "coco":
            true = COCO(truth_path)
            coco = COCOeval(true, true.loadRes(entries), "bbox")
            coco.params.imgIds = list(image_ids)
            coco.evaluate()
            coco.accumulate()
            coco.summarize()
            return coco.stats
        package = lvis_package.load()
        with lvis_package.quiet():
            true = package.LVIS(truth_path)
            lvis = package.LVISEval(true, package.LVISResults(true, entries), "segm")
            lvis.params.img_ids = list(image_ids)
            lvis.run()
        return np.array(list(lvis.get_results().values()))
