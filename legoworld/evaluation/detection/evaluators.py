"""The evaluators with a common interface: unmodified pycocotools and lvis, or hotcoco."""

# pycocotools fills its classes at run time, and its stubs know three kinds of IoU.
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false
# pyright: reportIncompatibleMethodOverride=false

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from typing import Any, Final, Literal

import numpy as np

from legoworld import exit_codes
from legoworld.errors import LegoWorldError, UsageError
from legoworld.evaluation.box_overlaps import box_ious
from legoworld.evaluation.detection import lvis_package
from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.payloads.boxes3d import corner_array
from legoworld.evaluation.detection.payloads.payload import IouType
from legoworld.evaluation.detection.problem import Floats
from legoworld.evaluation.detection.protocols import DetectionProtocol

EvaluatorKind = Literal["official", "fast"]
#: The evaluators print, and what they print is caught by exchanging the process's stdout.
_PRINTING: Final = threading.Lock()


class EvaluatorDisagreesError(LegoWorldError):
    """An evaluator's numbers differ from those recomputed from the recorded matches."""

    code = "evaluator_disagrees"
    exit_code = exit_codes.BLOCKED


@dataclass(frozen=True, kw_only=True)
class OfficialScores:
    """The results of an evaluator.

    official: its 12 or 13 numbers in its order, -1 where undefined; lines: its own wording;
    precision: (T, R, K, A), at the protocol's own cap, -1 where a category has no truth.
    """

    name: str
    version: str
    official: tuple[float, ...]
    lines: tuple[str, ...]
    precision: Floats


def run_evaluator(
    truth: Truth, predictions: Predictions, protocol: DetectionProtocol, kind: EvaluatorKind
) -> OfficialScores:
    """Score predictions over the images of the ground truth, which are the track's.

    Raises UsageError for boxes in space and an evaluator that does not score them.
    """
    with _PRINTING:
        if protocol.iou_type == "bbox3D":
            if kind == "fast":
                raise UsageError(
                    "hotcoco does not score boxes in space",
                    expected="--evaluator official: pycocotools with the IoU of boxes in space",
                )
            return _in_space(truth, predictions, protocol)
        if kind == "fast":
            return _hotcoco(truth, predictions, protocol)
        if protocol.federated:
            return _lvis(truth, predictions)
        return _pycocotools(truth, predictions, protocol.iou_type)


def _pycocotools(truth: Truth, predictions: Predictions, iou_type: IouType) -> OfficialScores:
    from pycocotools.cocoeval import COCOeval

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        true = _coco(truth.document())
        if entries := predictions.entries.results():
            results = true.loadRes(entries)
        else:  # loadRes cannot read an empty list
            results = _coco({**truth.document(), "annotations": []})
        evaluation = COCOeval(true, results, iou_type)
        evaluation.params.imgIds = [i["id"] for i in truth.images]
        evaluation.evaluate()
        evaluation.accumulate()
        printed.seek(0)
        printed.truncate()
        evaluation.summarize()
    return OfficialScores(
        name="pycocotools",
        version=metadata.version("pycocotools"),
        official=tuple(float(x) for x in evaluation.stats),
        lines=_printed_lines(printed.getvalue()),
        precision=np.asarray(evaluation.eval["precision"])[..., -1],
    )


def _coco(document: Mapping[str, Any]) -> Any:
    """A document as pycocotools holds one; its stubs do not know it given as a dict."""
    from pycocotools.coco import COCO

    held: Any = COCO()
    held.dataset = document
    held.createIndex()
    return held


def _in_space(
    truth: Truth, predictions: Predictions, protocol: DetectionProtocol
) -> OfficialScores:
    """pycocotools' matching and accumulation, averaged as its summarize does.

    It is given the IoU of boxes in space, depth as area, and annotations' own `ignore`.
    """
    from pycocotools.cocoeval import COCOeval

    class InSpace(COCOeval):  # type: ignore[misc]
        def _prepare(self) -> None:
            super()._prepare()
            for annotation in (a for cell in self._gts.values() for a in cell):
                annotation["ignore"] = true_ignore[annotation["id"]]

        def computeIoU(self, image_id: int, category_id: int) -> Any:  # noqa: N802
            mine, true = self._dts[image_id, category_id], self._gts[image_id, category_id]
            order = np.argsort([-d["score"] for d in mine], kind="mergesort")
            kept = [mine[k]["bbox3D"] for k in order[: self.params.maxDets[-1]]]
            if not kept or not true:
                return []
            return box_ious(corner_array(kept), corner_array([t["bbox3D"] for t in true]))

    grid = protocol.grid
    true_ignore = {a["id"]: a["ignore"] for a in truth.annotations}
    depths = corner_array(predictions.entries.shape)[:, :, 2].mean(axis=1).tolist()
    results = [
        {**entry, "id": number, "area": depth, "iscrowd": 0}
        for number, (entry, depth) in enumerate(
            zip(predictions.entries.results(), depths, strict=True), start=1
        )
    ]
    with contextlib.redirect_stdout(io.StringIO()):
        found = _coco({**truth.document(), "annotations": results})
        evaluation: Any = InSpace(_coco(truth.document()), found, "bbox")
        evaluation.params.imgIds = [i["id"] for i in truth.images]
        evaluation.params.iouThrs = grid.iou
        evaluation.params.areaRng = [list(bounds) for bounds in grid.ranges]
        evaluation.params.areaRngLbl = list(grid.areas)
        evaluation.evaluate()
        evaluation.accumulate()
    precision, recall = (np.asarray(evaluation.eval[key]) for key in ("precision", "recall"))
    official = []
    for metric in protocol.metrics:
        at, area = grid.thresholds(metric.iou), grid.areas.index(metric.area)
        cap = evaluation.params.maxDets.index(metric.max_rank or 100)
        values = (
            precision[at][..., area, cap] if metric.kind == "AP" else recall[at][:, :, area, cap]
        )
        defined = values[values > -1]
        official.append(float(np.mean(defined)) if defined.size else -1.0)
    return OfficialScores(
        name="pycocotools",
        version=metadata.version("pycocotools"),
        official=tuple(official),
        lines=tuple(
            f"{m.name} = {v:0.3f}" for m, v in zip(protocol.metrics, official, strict=True)
        ),
        precision=precision[..., -1],
    )


def _lvis(truth: Truth, predictions: Predictions) -> OfficialScores:
    package = lvis_package.load()
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), lvis_package.quiet():
        true = lvis_package.dataset(package, truth.document())
        results = lvis_package.results(package, true, predictions.entries.results())
        evaluation = package.LVISEval(true, results, "segm")
        evaluation.params.img_ids = [i["id"] for i in truth.images]
        evaluation.run()
        evaluation.print_results()
    return OfficialScores(
        name=lvis_package.PACKAGE,
        version=metadata.version(lvis_package.PACKAGE),
        official=tuple(float(x) for x in evaluation.get_results().values()),
        lines=_printed_lines(printed.getvalue()),
        precision=np.asarray(evaluation.eval["precision"]),
    )


def _hotcoco(truth: Truth, predictions: Predictions, protocol: DetectionProtocol) -> OfficialScores:
    import hotcoco

    true = hotcoco.COCO(truth.document())
    results = predictions.entries.results()
    if not results:
        detections = hotcoco.COCO({**truth.document(), "annotations": []})
    elif protocol.federated:
        detections = hotcoco.LVISResults(true, results, max_dets=protocol.per_image_cap)
    else:
        detections = true.load_res(results)
    del results  # it has copied what it read, and evaluates in gigabytes
    evaluation: Any = hotcoco.COCOeval(
        true, detections, protocol.iou_type, lvis_style=protocol.federated
    )
    evaluation.params.img_ids = [i["id"] for i in truth.images]
    evaluation.evaluate()
    evaluation.accumulate()
    with contextlib.redirect_stdout(io.StringIO()):
        evaluation.summarize()
    return OfficialScores(
        name="hotcoco",
        version=metadata.version("hotcoco"),
        official=tuple(float(x) for x in evaluation.stats),
        lines=tuple(evaluation.summary_lines()),
        precision=np.asarray(evaluation.eval["precision"])[..., -1],
    )


def _printed_lines(text: str) -> tuple[str, ...]:
    return tuple(line for line in text.splitlines() if line.strip())
