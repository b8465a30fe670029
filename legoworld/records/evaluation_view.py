"""view/ of an evaluation: what a report draws over the photos. Private, as truth is."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import Record


class Fit(Record, frozen=True, kw_only=True):
    """Depth: aligned disparity = scale * predicted disparity + shift."""

    scale: float
    shift: float
    status: Literal["ok", "inverted", "degenerate"]


class DepthView(Record, frozen=True, kw_only=True):
    """view/ID.json of depth: a small picture of truth and aligned prediction.

    Arrays are base64 of little-endian float32 metres along camera z, row major, inf where there is
    none; size_wh is theirs, image_wh the truth's.
    """

    size_wh: tuple[int, int]
    image_wh: tuple[int, int]
    truth_z_m: str
    aligned_z_m: str
    fit: Fit
