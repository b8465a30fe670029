"""Box formats: conversion to x, y, width, height, and checks of a declared format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Literal, cast, get_args

import numpy as np

from legoworld.baselines.foreign_results import Entry
from legoworld.evaluation.detection.inputs.box_formats import (
    MAX_SHARE_OUTSIDE,
    TOLERANCE_PX,
    TOLERANCE_SHARE,
    BoxFormatError,
    finite_floats,
)
from legoworld.pluralize import plural

BoxFormat = Literal["xywh", "xyxy", "cxcywh"]
BOX_FORMATS: Final[tuple[BoxFormat, ...]] = get_args(BoxFormat)


def with_xywh(entry: Entry, box_format: BoxFormat) -> Entry:
    """A results entry with its bbox as x, y, width, height; unchanged if it is not a box."""
    box = None if box_format == "xywh" else _box(entry)
    if box is None:
        return entry
    a, b, c, d = box
    converted = [a, b, c - a, d - b] if box_format == "xyxy" else [a - c / 2, b - d / 2, c, d]
    return {**entry, "bbox": converted}


def check_declared(
    as_given: Sequence[Entry], sizes_wh: Mapping[int, tuple[int, int]], box_format: BoxFormat
) -> None:
    """Raise BoxFormatError if the boxes fit their images in another format, but not as declared.

    as_given: entries with the file's own numbers. The check of a results list accepts boxes that no
    format explains; a declared format must be the one that explains them.
    """
    others = other_formats(as_given, sizes_wh, box_format)
    share = _shares_outside(as_given, sizes_wh).get(box_format, 0.0)
    if share > MAX_SHARE_OUTSIDE and others:
        raise BoxFormatError(
            f"the boxes are not {box_format} in pixels",
            found=f"{share:.1%} of {plural(len(as_given), 'box', 'boxes')} leave their image",
            expected="boxes inside their images",
            next_step=_pass(others),
        )


def rephrase_error(
    error: BoxFormatError, box_format: BoxFormat, others: Sequence[BoxFormat]
) -> BoxFormatError:
    """The error of a results list's check, rephrased for the declared and the fitting formats."""
    return BoxFormatError(
        f"the boxes are not {box_format} in pixels",
        found=error.found if box_format == "xywh" else f"as x, y, width, height: {error.found}",
        expected=error.expected,
        next_step=_pass(others) if others else error.next_step,
    )


def other_formats(
    as_given: Sequence[Entry], sizes_wh: Mapping[int, tuple[int, int]], box_format: BoxFormat
) -> list[BoxFormat]:
    """The formats other than the declared one in which the boxes fit their images."""
    shares = _shares_outside(as_given, sizes_wh)
    return [f for f in shares if f != box_format and shares[f] <= MAX_SHARE_OUTSIDE]


def _shares_outside(
    as_given: Sequence[Entry], sizes_wh: Mapping[int, tuple[int, int]]
) -> dict[BoxFormat, float]:
    """Per format, the share of boxes that leave their image or have a negative extent.

    Empty if undecidable: an entry is not a box, or all are fractions of the image's size.
    """
    boxes = [_box(entry) for entry in as_given]
    if not boxes or None in boxes:
        return {}
    given = np.array(boxes, np.float64)
    sizes = np.array([sizes_wh[cast("int", e["image_id"])] for e in as_given], np.float64)
    if (given <= 1.0).all():
        return {}
    a, b = given[:, :2], given[:, 2:]
    low_and_size = {"xywh": (a, b), "xyxy": (a, b - a), "cxcywh": (a - b / 2, b)}
    shares: dict[BoxFormat, float] = {}
    for box_format in BOX_FORMATS:
        low, size = low_and_size[box_format]
        tolerance = TOLERANCE_PX + TOLERANCE_SHARE * np.maximum(size, 0)
        outside = (low < -tolerance) | (low + size > sizes + tolerance) | (size < 0)
        shares[box_format] = float(outside.any(axis=1).mean())
    return shares


def _box(entry: Entry) -> list[float] | None:
    """The four numbers of an entry's box, as they are; None where it has none."""
    box = entry.get("bbox")
    if isinstance(box, list) and len(box) == 4 and finite_floats(box) is not None:
        return cast("list[float]", box)
    return None


def _pass(formats: Sequence[BoxFormat]) -> str:
    return f"pass --box-format {' or '.join(formats)}, in which they fit their images"
