"""Boxes and masks of the visible instances in the result formats of COCO and LVIS."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.records.predictions import Prediction, Rle
from legoworld.scene.instances import Instance
from legoworld.visibility.view import View

Export = tuple[Prediction, Instance]
"""A prediction and its instance."""


def exported(instances: Sequence[Instance], view: View) -> list[Instance]:
    """The exported instances: in the vocabulary, with at least one visible pixel."""
    return [i for i in instances if i.category is not None and view.area_px[i.id] > 0]


def box_predictions(image_id: int, instances: Sequence[Instance], view: View) -> list[Prediction]:
    """COCO box results of one image, in canonical order: category id, then the box's numbers."""
    return [prediction for prediction, _ in box_exports(image_id, instances, view)]


def box_exports(image_id: int, instances: Sequence[Instance], view: View) -> list[Export]:
    """`box_predictions`, each with its instance."""
    found = [(i, bbox_xywh_px(view, i.id)) for i in exported(instances, view)]
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
        for instance, box in sorted(found, key=lambda f: (_category_id(f[0]), f[1]))
    ]


def mask_predictions(image_id: int, instances: Sequence[Instance], view: View) -> list[Prediction]:
    """Mask results of one image, in canonical order: category id, then the RLE's bytes.

    Without bbox: the official evaluators would use the box's area as the mask's.
    """
    return [prediction for prediction, _ in mask_exports(image_id, instances, view)]


def mask_exports(image_id: int, instances: Sequence[Instance], view: View) -> list[Export]:
    """`mask_predictions`, each with its instance."""
    runs = ColumnRuns(view.buffers.instance)
    found = [(i, runs.counts(i.id)) for i in exported(instances, view)]
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
        for instance, counts in sorted(found, key=lambda f: (_category_id(f[0]), f[1]))
    ]


def _category_id(instance: Instance) -> int:
    assert instance.category is not None
    return instance.category.id


def bbox_xywh_px(view: View, instance_id: int) -> tuple[int, int, int, int]:
    """The extent of an instance's visible pixels: x, y, width, height at pixel edges."""
    x0, y0, x1, y1 = (int(v) for v in view.bbox_xyxy_px[instance_id])
    return x0, y0, x1 - x0, y1 - y0


class ColumnRuns:
    """Runs of equal ids down the columns of an (H, W) id image, the units of COCO's RLE.

    Computed once for all instances: a separate mask each would cost H x W per instance.
    """

    def __init__(self, instance: NDArray[np.int32]) -> None:
        self.size_hw: tuple[int, int] = (instance.shape[0], instance.shape[1])
        flat = instance.T.ravel()
        first = np.concatenate(([0], np.flatnonzero(flat[1:] != flat[:-1]) + 1))
        ids = flat[first]
        order = np.argsort(ids, kind="stable")
        self._ids, self._first = ids[order], first[order]
        self._end = np.append(first[1:], flat.size)[order]

    def counts(self, instance_id: int) -> str:
        """Compressed RLE counts of one instance, byte for byte as pycocotools encodes its mask."""
        from pycocotools import mask as coco_mask

        low, high = np.searchsorted(self._ids, (instance_id, instance_id + 1))
        first, end = self._first[low:high], self._end[low:high]
        counts = np.empty(2 * len(first) + 1, np.uint32)  # the type the encoder works with
        counts[0:-1:2][:1] = first[:1]
        counts[2:-1:2] = first[1:] - end[:-1]
        counts[1::2] = end - first
        height, width = self.size_hw
        counts[-1] = height * width - (end[-1] if len(end) else 0)
        if counts[-1] == 0:
            counts = counts[:-1]
        rle: Any = {"size": [height, width], "counts": counts}
        encoded: bytes = coco_mask.frPyObjects(rle, height, width)["counts"]
        return encoded.decode("ascii")
