"""How a submission of bench-x is looked at besides its picture, and what a run keeps of that."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from legoworld.records.base import Record

Vector = tuple[float, float, float]
#: (4, 4) rows of a rigid motion, metres, OpenCV camera axes.
Motion = tuple[
    tuple[float, float, float, float],
    tuple[float, float, float, float],
    tuple[float, float, float, float],
    tuple[float, float, float, float],
]


class SecondView(Record, frozen=True, kw_only=True):
    """A second camera. cam_from_view: its pose in the frame of the case's camera."""

    cam_from_view: Motion
    hfov_deg: Annotated[float, Meta(gt=0, lt=180)]


class Probe(Record, frozen=True, kw_only=True):
    """Private: where a case's submission is looked at.

    offset_px: of every raster sample from its pixel's centre, in raster pixels; view: null where no
    second camera sees the same objects; boxes: of the scored objects in their order, two corners in
    the camera frame, metres, grown by the tolerance; spacings_m: of the samples in each box.
    """

    offset_px: tuple[float, float]
    view: SecondView | None
    boxes_m: tuple[tuple[Vector, Vector], ...]
    spacings_m: tuple[float, ...]
