"""view/ of an evaluation: what a report draws over the photos. Private, as truth is."""

from __future__ import annotations

from typing import Literal

from msgspec import field

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.predictions import Box, Corners, Number, Point, Prediction, Rle


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


class NormalsView(Record, frozen=True, kw_only=True):
    """view/ID.json of normals: a small picture of truth and prediction.

    Arrays are base64 of little-endian float32 x, y, z towards the camera, row major, NaN where
    there is none; size_wh is theirs, image_wh the truth's.
    """

    size_wh: tuple[int, int]
    image_wh: tuple[int, int]
    truth: str
    predicted: str


#: A mask, or polygons of x, y, x, y, ...
Segmentation = Rle | tuple[tuple[Number, ...], ...]


class TrueImage(Record, frozen=True, kw_only=True):
    """A photo of the truth. intrinsics: rows of K, where boxes in space are scored."""

    id: int
    width: int
    height: int
    intrinsics: tuple[Point, Point, Point] | UnsetType = field(default=UNSET, name="K")


class TrueCategory(Record, frozen=True, kw_only=True):
    """A category of the truth. frequency: LVIS's letter."""

    id: int
    name: str
    frequency: str | UnsetType = UNSET


class TrueAnnotation(Record, frozen=True, kw_only=True):
    """One instance of the truth, as its file has it. bbox: x, y, width, height."""

    image_id: int
    category_id: int
    bbox: Box
    area: Number | UnsetType = UNSET
    segmentation: Segmentation | UnsetType = UNSET
    visible_mask: Segmentation | UnsetType = UNSET
    iscrowd: Number | UnsetType = UNSET
    ignore: Number | UnsetType = UNSET
    corners: Corners | UnsetType = field(default=UNSET, name="bbox3D")


class TruthCategories(Record, frozen=True, kw_only=True):
    """view/truth.json of boxes and masks, as far as it is about categories."""

    categories: tuple[TrueCategory, ...]


class TruthView(TruthCategories, frozen=True, kw_only=True):
    """view/truth.json of boxes and masks: the truth of the track's images."""

    images: tuple[TrueImage, ...]
    annotations: tuple[TrueAnnotation, ...]


class ShownPrediction(Prediction, frozen=True, kw_only=True):
    """One of view/predictions.json. outcome_50: what the evaluator made of it at IoU 0.5."""

    outcome_50: Literal["tp", "fp", "ignored", "unverified", "over_cap"]
