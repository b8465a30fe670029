"""Boxes and masks of the visible instances in the result formats of COCO and LVIS."""

from __future__ import annotations

from collections.abc import Sequence

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.readouts.family import Export
from legoworld.records.predictions import Prediction, Rle
from legoworld.scene.instances import Instance
from legoworld.visibility.runs import ColumnRuns
from legoworld.visibility.view import View


def select_exported(instances: Sequence[Instance], view: View) -> list[Instance]:
    """The exported instances: in the vocabulary, with at least one visible pixel."""
    area_px = view.area_px.tolist()
    return [i for i in instances if i.category is not None and area_px[i.id]]


def box_exports(image_id: int, instances: Sequence[Instance], view: View) -> list[Export]:
    """COCO box results of one image, in canonical order: category id, then the box's numbers."""
    boxes = [(i, bbox_xywh_px(view, i.id)) for i in select_exported(instances, view)]
    return [
        (
            Prediction(
                image_id=image_id,
                category_id=_category_id(instance),
                bbox=box,
                score=EQUAL_CONFIDENCE,
            ),
            instance,
        )
        for instance, box in sorted(boxes, key=lambda f: (_category_id(f[0]), f[1]))
    ]


def mask_exports(image_id: int, instances: Sequence[Instance], view: View) -> list[Export]:
    """Mask results of one image, in canonical order: category id, then the RLE's bytes.

    Without bbox: the official evaluators would use the box's area as the mask's.
    """
    runs = ColumnRuns(view.buffers.instance, len(view.area_px))
    masks = [(i, runs.counts(i.id)) for i in select_exported(instances, view)]
    return [
        (
            Prediction(
                image_id=image_id,
                category_id=_category_id(instance),
                segmentation=Rle(size=runs.size_hw, counts=counts),
                score=EQUAL_CONFIDENCE,
            ),
            instance,
        )
        for instance, counts in sorted(masks, key=lambda f: (_category_id(f[0]), f[1]))
    ]


def _category_id(instance: Instance) -> int:
    assert instance.category is not None
    return instance.category.id


def bbox_xywh_px(view: View, instance_id: int) -> tuple[int, int, int, int]:
    """The extent of an instance's visible pixels: x, y, width, height at pixel edges."""
    x0, y0, x1, y1 = view.bbox_xyxy_px[instance_id].tolist()
    return x0, y0, x1 - x0, y1 - y0
