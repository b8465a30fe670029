"""What the page draws: boxes, polygons and masks as small JSON; the browser makes the outlines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.records.base import UNSET
from legoworld.records.coco_file import ShownPrediction, TrueAnnotation
from legoworld.records.report_page import DrawnPrediction, DrawnTruth
from legoworld.records.run_rows import Exported
from legoworld.report.detection_images import DetectionImage, SideImage

_PLACES = 2


def drawn_truths(task: str, image: DetectionImage) -> list[DrawnTruth]:
    """Each truth: its box, and its mask or polygons where masks are scored."""
    return [DrawnTruth(c=t.category_id, **_outline(task, image, t)) for t in image.truths]


def drawn_predictions(task: str, image: DetectionImage, side: SideImage) -> list[DrawnPrediction]:
    """Each prediction with its outcome."""
    drawn = []
    for (entry, kind, about, iou), own in zip(
        zip(side.entries, side.errors.kind, side.errors.about, side.errors.iou, strict=True),
        _scene_objects(side),
        strict=True,
    ):
        drawn.append(
            DrawnPrediction(
                n=own.name if own else UNSET,
                m=own.objects if own else UNSET,
                c=entry.category_id,
                s=entry.score,
                o=entry.outcome_50,
                k=kind,
                t=about,
                i=None if iou is None else round(iou, 4),
                **_outline(task, image, entry),
            )
        )
    return drawn


def _outline(
    task: str, image: DetectionImage, row: TrueAnnotation | ShownPrediction
) -> dict[str, Any]:
    """The fields of what is drawn of a row, its coordinates rounded."""
    outline = detection_protocol(task).payload.outline(row, image.image)
    polygons = outline.polygons
    return {
        "box": _round_values(outline.box),
        "rle": UNSET if outline.rle is None else outline.rle,
        "h": UNSET if outline.hidden is None else outline.hidden,
        "polygons": UNSET if polygons is None else tuple(map(_round_values, polygons)),
    }


def _scene_objects(side: SideImage) -> Sequence[Exported | None]:
    """Name and objects of every prediction of a scene, which its run lists in the same order."""
    exported = side.run_row.exported
    if not exported or len(exported) != len(side.entries):
        return [None] * len(side.entries)
    return exported


def _round_values(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(round(v, _PLACES) for v in values)
