"""What the page draws: boxes, polygons and masks as small JSON; the browser makes the outlines."""

from __future__ import annotations

from typing import Any

from legoworld.evaluation.masks import bounding_box, compressed
from legoworld.evaluation.protocols import detection_protocol
from legoworld.evaluation.reading import Row
from legoworld.report.detection_images import DetectionImage, SideImage

_PLACES = 2


def drawn_truths(task: str, image: DetectionImage) -> list[Row]:
    """Each truth: c category id, box [x, y, w, h], mask or polygons where masks are scored."""
    size_hw = image.image["height"], image.image["width"]
    masks = detection_protocol(task).iou_type == "segm"
    found = []
    for truth in image.truths:
        drawn: Row = {"c": truth["category_id"], "box": _rounded(truth["bbox"])}
        segmentation = truth.get("segmentation")
        if masks and isinstance(segmentation, list):
            drawn["polygons"] = [_rounded(p) for p in segmentation]
        elif masks:
            drawn["rle"] = _counts(segmentation, size_hw)
        found.append(drawn)
    return found


def drawn_predictions(task: str, image: DetectionImage, side: SideImage) -> list[Row]:
    """Each prediction: c, s score, o outcome at IoU 0.5, k error kind, t truth meant, i IoU."""
    size_hw = image.image["height"], image.image["width"]
    masks = detection_protocol(task).iou_type == "segm"
    found = []
    for entry, kind, about, iou in zip(
        side.entries, side.errors.kind, side.errors.about, side.errors.iou, strict=True
    ):
        drawn: Row = {"c": entry["category_id"], "s": entry["score"], "o": entry["outcome_50"]}
        if masks:
            drawn["rle"] = _counts(entry["segmentation"], size_hw)
            drawn["box"] = bounding_box(compressed(entry["segmentation"], size_hw))
        else:
            drawn["box"] = _rounded(entry["bbox"])
        drawn |= {"k": kind, "t": about, "i": iou}
        found.append(drawn)
    return found


def _counts(segmentation: Any, size_hw: tuple[int, int]) -> str:
    """pycocotools' compressed counts of any mask of the image."""
    text: str = compressed(segmentation, size_hw)["counts"].decode("ascii")
    return text


def _rounded(values: list[float]) -> list[float]:
    return [round(v, _PLACES) for v in values]
