"""--intrinsics of a depth import: the pinholes that ray distances were measured from."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from legoworld.records.base import Record
from legoworld.records.track import Pixels

Focal = Annotated[float, Meta(gt=0)]


class CameraEntry(Record, frozen=True, kw_only=True):
    """A pinhole in pixels. width, height: of the array it is for, where that is another size."""

    fx: Focal
    fy: Focal
    cx: float
    cy: float
    width: Pixels | None = None
    height: Pixels | None = None
