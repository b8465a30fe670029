"""Steps that might mend a loose prediction, each tried on a copy of it before it is advised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.inputs.masks import (
    EncodedMask,
    from_pixels,
    overlaps,
    to_pixels,
)
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.report.detection_images import DetectionImage, SideImage, shapes

#: A prediction of which this share lies in a truth may belong to what the truth shows.
_INSIDE: Final = 0.8
#: A step that gains less IoU is not worth a word.
_GAIN: Final = 0.05


@dataclass(frozen=True, kw_only=True)
class Tried:
    """What helps a prediction that covers its truth too little, by the IoU it would have.

    given_back: predictions of other categories in the truth, that with it cover it better;
    together_iou: with them. fitted_iou: moved and scaled to the truth's box.
    """

    iou: float
    given_back: tuple[int, ...]
    together_iou: float
    fitted_iou: float

    @property
    def parts_help(self) -> bool:
        """Whether giving parts back gains, and more than a better place and size."""
        return self.together_iou >= max(self.iou + _GAIN, self.fitted_iou)

    @property
    def fit_helps(self) -> bool:
        """Whether a better place and size gain."""
        return self.fitted_iou >= self.iou + _GAIN


def try_steps(task: str, image: DetectionImage, side: SideImage, entry: int, truth: int) -> Tried:
    """Try both steps on one prediction of a side, by its place there, and its truth."""
    predicted = shapes(task, image.image, side.entries)
    wanted = shapes(task, image.image, [image.truths[truth]])
    own = side.entries[entry].category_id
    payload = detection_protocol(task).payload
    inside = payload.compared(predicted, wanted, [1])[:, 0]
    parts = tuple(
        d
        for d, other in enumerate(side.entries)
        if other.category_id != own and inside[d] >= _INSIDE
    )
    iou = float(side.iou[entry, truth])
    together = iou
    if parts:
        whole = payload.together([predicted[entry], *(predicted[d] for d in parts)])
        together = float(payload.compared([whole], wanted, [0])[0, 0])
    return Tried(
        iou=iou,
        given_back=parts,
        together_iou=together,
        fitted_iou=_fitted_iou(predicted[entry], wanted[0]),
    )


def _fitted_iou(shape: Any, wanted: Any) -> float:
    """IoU with a truth once the shape's box is the truth's: of boxes 1, of masks of one picture."""
    if not isinstance(shape, dict):
        return 1.0
    pixels, true = to_pixels(cast("EncodedMask", shape)), to_pixels(wanted)
    if not pixels.any() or not true.any():
        return 0.0
    rows, columns = _extent(true)
    size_wh = columns.stop - columns.start, rows.stop - rows.start
    fitted = np.zeros_like(true)
    fitted[rows, columns] = cv2.resize(
        pixels[_extent(pixels)], size_wh, interpolation=cv2.INTER_NEAREST
    )
    return float(overlaps([from_pixels(fitted)], [wanted], [0])[0, 0])


def _extent(pixels: NDArray[np.uint8]) -> tuple[slice, slice]:
    """The rows and columns that hold pixels."""
    rows, columns = np.flatnonzero(pixels.any(axis=1)), np.flatnonzero(pixels.any(axis=0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
