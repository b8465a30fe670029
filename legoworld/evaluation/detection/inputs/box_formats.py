"""Plausibility checks of boxes: x, y, width, height in pixels, and not another format."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, TypeGuard

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.files import Json

#: A box may leave its image by this much, and by this share of its side, as those of detectors
#: that do not clip do, before its format is doubted.
TOLERANCE_PX: Final = 2.0
TOLERANCE_SHARE: Final = 0.25
#: When a larger share of boxes leaves its image, they are in another format: one in which all
#: would lie inside, or, from the larger share on, an unknown one.
MAX_SHARE_OUTSIDE: Final = 0.04
_MAX_SHARE_UNEXPLAINED: Final = 0.5
_XYWH: Final = "pass x, y, width, height in pixels of the image"


Sizes = Mapping[int, tuple[int, int]]


class BoxFormatError(LegoWorldError):
    """Boxes are not x, y, width, height in pixels of their image."""

    code = "box_format"


def check_box_values(
    image_ids: Sequence[int], boxes: Sequence[Json], sizes_wh: Sizes
) -> Mapping[str, int]:
    """BoxFormatError for a box no format explains: not four numbers, or of negative extent.

    boxes: of each of the images, whatever a file has there.
    """
    _check_boxes(image_ids, boxes, sizes_wh)
    return {}


def check_box_format(
    image_ids: Sequence[int], boxes: Sequence[Json], sizes_wh: Sizes
) -> Mapping[str, int]:
    """Counted anomalies of scorable boxes. BoxFormatError for boxes that cannot be scored."""
    if not boxes:
        return {}
    boxes_xywh = _check_boxes(image_ids, boxes, sizes_wh)
    sizes = _sizes(image_ids, sizes_wh)
    outside = _outside(boxes_xywh[:, :2], boxes_xywh[:, :2] + boxes_xywh[:, 2:], sizes)
    if (boxes_xywh <= 1.0).all() and (boxes_xywh % 1 != 0).any() and (sizes > 8).all():
        raise _error(
            _format_box(image_ids[0], boxes[0]),
            "pixels",
            "these look like fractions of the image's size",
        )
    hint = _hint(boxes_xywh, sizes)
    if outside.mean() > (MAX_SHARE_OUTSIDE if hint != _XYWH else _MAX_SHARE_UNEXPLAINED):
        worst = int(np.argmax(outside))
        raise _error(
            f"{int(outside.sum())} of {len(boxes)} boxes leave their image, such as "
            + _format_box(image_ids[worst], boxes[worst]),
            "boxes inside their images",
            hint,
        )
    over = _outside(boxes_xywh[:, :2], boxes_xywh[:, :2] + boxes_xywh[:, 2:], sizes, share=0.0)
    odd = {
        "boxes that leave their image by over 2 px": int(over.sum()),
        "boxes without any area": int((boxes_xywh[:, 2:] == 0).any(axis=1).sum()),
    }
    return {what: count for what, count in odd.items() if count}


def _check_boxes(
    image_ids: Sequence[int], boxes: Sequence[Json], sizes_wh: Sizes
) -> NDArray[np.float64]:
    """(n, 4) boxes of four finite numbers and no negative extent."""
    for image_id, box in zip(image_ids, boxes, strict=True):
        if not isinstance(box, list | tuple) or len(box) != 4:
            raise _error(_format_box(image_id, box), "four finite numbers")
    numbers = finite_floats(itertools.chain.from_iterable(boxes))  # type: ignore[arg-type]
    if numbers is None:
        bad = next(k for k, box in enumerate(boxes) if not all(map(is_finite, box)))  # type: ignore[arg-type]
        raise _error(_format_box(image_ids[bad], boxes[bad]), "four finite numbers")
    boxes_xywh = numbers.reshape(-1, 4)
    negative = np.flatnonzero((boxes_xywh[:, 2:] < 0).any(axis=1))
    if len(negative):
        raise _error(
            _format_box(image_ids[negative[0]], boxes[negative[0]]),
            "a width and height of at least 0",
            _hint(boxes_xywh, _sizes(image_ids, sizes_wh)),
        )
    return boxes_xywh


def _sizes(image_ids: Sequence[int], sizes_wh: Sizes) -> NDArray[np.float64]:
    """(n, 2) sizes of the boxes' images."""
    sizes = list(itertools.chain.from_iterable(sizes_wh[i] for i in image_ids))
    return np.array(sizes, np.float64).reshape(-1, 2)


def _outside(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    sizes: NDArray[np.float64],
    share: float = TOLERANCE_SHARE,
) -> NDArray[np.bool_]:
    tolerance = TOLERANCE_PX + share * np.maximum(high - low, 0)
    outside: NDArray[np.bool_] = ((low < -tolerance) | (high > sizes + tolerance)).any(axis=1)
    return outside


def _hint(boxes: NDArray[np.float64], sizes: NDArray[np.float64]) -> str:
    """The format in which all boxes would be inside their images."""
    corners = boxes[:, 2:] >= boxes[:, :2]
    if corners.all() and not _outside(boxes[:, :2], boxes[:, 2:], sizes).any():
        return "these look like x1, y1, x2, y2: pass x, y, width, height"
    half = boxes[:, 2:] / 2
    if (half >= 0).all() and not _outside(boxes[:, :2] - half, boxes[:, :2] + half, sizes).any():
        return "these look like centre x, centre y, width, height: pass x, y, width, height"
    return _XYWH


def _error(found: str, expected: str, hint: str = _XYWH) -> BoxFormatError:
    return BoxFormatError(
        "the boxes are not x, y, width, height in pixels",
        found=found,
        expected=expected,
        next_step=hint,
    )


def _format_box(image_id: int, box: Json) -> str:
    return f"image {image_id}: bbox {[*box] if isinstance(box, tuple) else box!r}"


def is_finite(value: Json) -> TypeGuard[float]:
    """Whether a JSON value is a number that a float can hold."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    return abs(value) <= sys.float_info.max  # math.isfinite raises for an integer of 400 digits


def finite_floats(values: Iterable[Json]) -> NDArray[np.float64] | None:
    """(n,) JSON values as float64; None where any is of another type, or none a float can hold."""
    floats = list(values)
    if not set(map(type, floats)) <= {int, float}:
        return None
    try:
        array = np.array(floats, np.float64)
    except OverflowError:  # an integer of 400 digits
        return None
    return array if np.isfinite(array).all() else None
