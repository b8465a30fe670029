"""Boxes and masks of the visible instances, in COCO's and LVIS's result formats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.scene.instances import Instance
from legoworld.visibility.view import View


def exported(instances: Sequence[Instance], view: View) -> list[Instance]:
    """The instances a task exports: of the vocabulary, with at least one visible pixel."""
    return [i for i in instances if i.category is not None and view.area_px[i.id] > 0]


def box_predictions(
    image_id: int, instances: Sequence[Instance], view: View
) -> list[dict[str, Any]]:
    """COCO box results of one image, in canonical order: category id, then the box's numbers."""
    rows = []
    for instance in exported(instances, view):
        assert instance.category is not None
        rows.append(
            {
                "image_id": image_id,
                "category_id": instance.category.id,
                "bbox": bbox_xywh_px(view, instance.id),
                "score": EQUAL_CONFIDENCE,
            }
        )
    return sorted(rows, key=lambda r: (r["category_id"], r["bbox"]))


def mask_predictions(
    image_id: int, instances: Sequence[Instance], view: View
) -> list[dict[str, Any]]:
    """LVIS mask results of one image, in canonical order: category id, then the RLE's bytes.

    No bbox: the official evaluator would take the box's area for the mask's.
    """
    rows = []
    for instance in exported(instances, view):
        assert instance.category is not None
        rows.append(
            {
                "image_id": image_id,
                "category_id": instance.category.id,
                "segmentation": mask_rle(view, instance.id),
                "score": EQUAL_CONFIDENCE,
            }
        )
    return sorted(rows, key=lambda r: (r["category_id"], r["segmentation"]["counts"].encode()))


def bbox_xywh_px(view: View, instance_id: int) -> list[int]:
    """The extent of an instance's visible pixels: x, y, width, height in pixel edges."""
    x0, y0, x1, y1 = (int(v) for v in view.bbox_xyxy_px[instance_id])
    return [x0, y0, x1 - x0, y1 - y0]


def mask_rle(view: View, instance_id: int) -> dict[str, Any]:
    """Compressed RLE, as pycocotools makes it, of an instance's visible pixels; counts as text."""
    from pycocotools import mask as coco_mask

    width, height = view.size_wh
    x0, y0, x1, y1 = (int(v) for v in view.bbox_xyxy_px[instance_id])
    mask: NDArray[np.uint8] = np.zeros((height, width), np.uint8, order="F")
    mask[y0:y1, x0:x1] = view.buffers.instance[y0:y1, x0:x1] == instance_id
    encoded = coco_mask.encode(mask)
    return {"size": [height, width], "counts": encoded["counts"].decode("ascii")}
