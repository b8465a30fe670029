"""Steps that might mend a loose prediction, each tried on a copy of it before it is advised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.inputs.masks import EncodedMask, from_pixels, to_pixels
from legoworld.evaluation.detection.payloads.masks import MASKS
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.report.detection_images import DetectionImage, SideImage, shapes
from legoworld.report.error_kinds import FOREGROUND_IOU

#: A prediction of which this share lies in a truth may belong to what the truth shows.
_INSIDE: Final = 0.8
#: A step that gains less IoU is not worth a word.
_GAIN: Final = 0.05
#: A prediction of this IoU is not loose.
_ENOUGH: Final = 0.75
#: A shift is one where so many pairs agree within a share of the objects' size, and finds as many;
#: it is looked for where less than half of the objects are covered.
_FLAT: Final = ("bbox", "segm")
_AGREEING: Final = 3
_ALIKE: Final = 0.1
_MOST_PAIRS: Final = 500


@dataclass(frozen=True, kw_only=True)
class Gains:
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
        """Whether giving parts back gains, and is enough or more than a better place and size.

        What is there already needs no new shape, which a fitted one is assumed to have.
        """
        enough = min(self.fitted_iou, _ENOUGH)
        return self.together_iou >= max(self.iou + _GAIN, enough)

    @property
    def fit_helps(self) -> bool:
        """Whether a better place and size gain."""
        return self.fitted_iou >= self.iou + _GAIN


def try_steps(task: str, image: DetectionImage, side: SideImage, entry: int, truth: int) -> Gains:
    """Gains of both steps for a prediction. entry, truth: indices in `side` and `image`."""
    predicted = shapes(task, image.image, side.entries)
    wanted = shapes(task, image.image, [image.truths[truth]])
    own = side.entries[entry].category_id
    payload = detection_protocol(task).payload
    inside = payload.compare_shapes(predicted, wanted, [1])[:, 0]
    parts = tuple(
        d
        for d, other in enumerate(side.entries)
        if other.category_id != own and inside[d] >= _INSIDE
    )
    iou = float(side.iou[entry, truth])
    together = iou
    if parts:
        whole = payload.enclose_shapes([predicted[entry], *(predicted[d] for d in parts)])
        together = float(payload.compare_shapes([whole], wanted, [0])[0, 0])
    return Gains(
        iou=iou,
        given_back=parts,
        together_iou=together,
        fitted_iou=_fitted_iou(predicted[entry], wanted[0]),
    )


@dataclass(frozen=True, kw_only=True)
class Shift:
    """All predictions of a photo moved right and down by the same pixels.

    iou: (D, G) with them; n_found_before, n_found: truths that their category's predictions cover.
    """

    right_px: int
    down_px: int
    iou: NDArray[np.float64]
    n_found_before: int
    n_found: int


def common_shift(task: str, image: DetectionImage, side: SideImage) -> Shift | None:
    """The shift that most pairs of a category agree on, where it finds more truths; or None."""
    payload = detection_protocol(task).payload
    if payload.iou_type not in _FLAT or min(len(side.entries), len(image.truths)) < _AGREEING:
        return None
    same = _same_category(image, side)
    before = _count_covered(side.iou, same)
    if 2 * before >= len(image.truths) or same.sum() > _MOST_PAIRS:
        return None
    pairs = np.argwhere(same)
    theirs, ours = (
        np.array([payload.outline(row, image.image).box for row in rows], np.float64)
        for rows in (side.entries, image.truths)
    )
    apart = ours[pairs[:, 1], :2] - theirs[pairs[:, 0], :2]
    apart += (ours[pairs[:, 1], 2:] - theirs[pairs[:, 0], 2:]) / 2
    near = _ALIKE * np.median(ours[:, 2:])
    agree: NDArray[np.bool_] = (np.abs(apart[:, None] - apart[None]) <= near).all(axis=2)
    best = agree[int(agree.sum(axis=1).argmax())]
    right, down = (round(v) for v in np.median(apart[best], axis=0).tolist())
    if np.count_nonzero(best) < _AGREEING or not (right or down):
        return None
    moved = [_move_shape(shape, right, down) for shape in shapes(task, image.image, side.entries)]
    crowd = [int(bool(t.iscrowd)) for t in image.truths]
    iou = payload.compare_shapes(moved, shapes(task, image.image, image.truths), crowd)
    n_found = _count_covered(iou, same)
    if n_found - before < _AGREEING:
        return None
    return Shift(right_px=right, down_px=down, iou=iou, n_found_before=before, n_found=n_found)


def shift_words(right: int, down: int, scale: float = 1.0) -> str:
    """A shift in pixels of the photo, scale of which one of its own is."""
    ways = (right, "right", "left"), (down, "down", "up")
    said = (f"{abs(n) * scale:.0f} px {more if n > 0 else less}" for n, more, less in ways if n)
    return " and ".join(said)


def _same_category(image: DetectionImage, side: SideImage) -> NDArray[np.bool_]:
    """(D, G); not of truths that are ignored."""
    theirs = np.array([p.category_id for p in side.entries])
    ours = np.array([t.category_id for t in image.truths])
    counted = np.array([state != "ignored" for state in side.errors.truth])
    same: NDArray[np.bool_] = (theirs[:, None] == ours) & counted
    return same


def _count_covered(iou: NDArray[np.float64], same: NDArray[np.bool_]) -> int:
    return int(((iou >= FOREGROUND_IOU) & same).any(axis=0).sum())


def _move_shape(shape: Any, right: int, down: int) -> Any:
    """A box, or a mask, elsewhere; what leaves the picture is cut off."""
    if not isinstance(shape, dict):
        return [shape[0] + right, shape[1] + down, *shape[2:]]
    pixels = to_pixels(cast("EncodedMask", shape))
    matrix = np.array([[1, 0, right], [0, 1, down]], np.float64)
    return from_pixels(cv2.warpAffine(pixels, matrix, pixels.shape[::-1], flags=cv2.INTER_NEAREST))


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
    return float(MASKS.compare_shapes([from_pixels(fitted)], [wanted], [0])[0, 0])


def _extent(pixels: NDArray[np.uint8]) -> tuple[slice, slice]:
    """The rows and columns that hold pixels."""
    rows, columns = np.flatnonzero(pixels.any(axis=1)), np.flatnonzero(pixels.any(axis=0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
