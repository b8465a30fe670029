"""What the page draws: boxes, polygons and masks as small JSON; the browser makes the outlines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from legoworld.evaluation.detection.inputs.masks import EncodedMask, bounding_box
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.records.base import UNSET
from legoworld.records.predictions import Rle
from legoworld.records.report_page import Drawn, DrawnPrediction
from legoworld.records.run_rows import Exported
from legoworld.report.detection_images import DetectionImage, SideImage, mask_of

_PLACES = 2


def drawn_truths(task: str, image: DetectionImage) -> list[Drawn]:
    """Each truth: its box, and its mask or polygons where masks are scored."""
    masks = detection_protocol(task).iou_type == "segm"
    drawn = []
    for truth in image.truths:
        shape, box = truth.segmentation, _rounded(truth.bbox)
        if not masks:
            drawn.append(Drawn(c=truth.category_id, box=box))
        elif isinstance(shape, Rle):
            rle = _text(mask_of(truth, image.image))
            drawn.append(Drawn(c=truth.category_id, box=box, rle=rle))
        else:
            polygons = tuple(map(_rounded, shape or ()))
            drawn.append(Drawn(c=truth.category_id, box=box, polygons=polygons))
    return drawn


def drawn_predictions(task: str, image: DetectionImage, side: SideImage) -> list[DrawnPrediction]:
    """Each prediction with its outcome."""
    masks = detection_protocol(task).iou_type == "segm"
    drawn = []
    for (entry, kind, about, iou), own in zip(
        zip(side.entries, side.errors.kind, side.errors.about, side.errors.iou, strict=True),
        _scene_objects(side),
        strict=True,
    ):
        mask = mask_of(entry, image.image) if masks else None
        drawn.append(
            DrawnPrediction(
                n=own.name if own else UNSET,
                m=own.objects if own else UNSET,
                c=entry.category_id,
                s=entry.score,
                o=entry.outcome_50,
                box=tuple(bounding_box(mask)) if mask else _rounded(entry.bbox or ()),
                rle=_text(mask) if mask else UNSET,
                k=kind,
                t=about,
                i=None if iou is None else round(iou, 4),
            )
        )
    return drawn


def _scene_objects(side: SideImage) -> Sequence[Exported | None]:
    """Name and objects of every prediction of a scene, which its run lists in the same order."""
    exported = side.run_row.exported
    if not exported or len(exported) != len(side.entries):
        return [None] * len(side.entries)
    return exported


def _text(mask: EncodedMask) -> str:
    """pycocotools' compressed counts of a mask."""
    return mask["counts"].decode("ascii")


def _rounded(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(round(v, _PLACES) for v in values)
