"""One prediction: an entry of predictions.json, and a line of the files it is divided into."""

from __future__ import annotations

from typing import Literal

from msgspec import field

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.track import Id

# gc=False: none can be part of a cycle, and there are millions.

Number = int | float
#: x, y, width, height in pixels.
Box = tuple[Number, Number, Number, Number]


Point = tuple[Number, Number, Number]
#: Corners of a box in space, in Omni3D's order (visibility/cuboids.py).
Corners = tuple[Point, Point, Point, Point, Point, Point, Point, Point]


class Rle(Record, frozen=True, kw_only=True, gc=False):
    """A mask's run lengths, or pycocotools' compressed counts; size is (height, width)."""

    size: tuple[int, int]
    counts: str | tuple[int, ...]


class Scored(Record, frozen=True, kw_only=True, gc=False):
    """What every prediction says besides where it is."""

    image_id: Id
    category_id: Id
    score: Number


class BoxPrediction(Scored, frozen=True, kw_only=True, gc=False):
    """A prediction where boxes are scored, from any source; other fields are ignored."""

    bbox: Box


class MaskPrediction(Scored, frozen=True, kw_only=True, gc=False):
    """A prediction where masks are scored, from any source. bbox: allowed, not scored."""

    segmentation: Rle
    bbox: object = UNSET


class AmodalPrediction(MaskPrediction, frozen=True, kw_only=True, gc=False):
    """A prediction where amodal masks are scored. visible_mask: where the source has one."""

    visible_mask: Rle | UnsetType = UNSET


class Box3dPrediction(Scored, frozen=True, kw_only=True, gc=False):
    """A prediction where boxes in space are scored, from any source; other fields are ignored."""

    corners: Corners = field(name="bbox3D")


#: Instances, None for all unlabelled geometry together, and pixels at which each hides another.
Occluders = tuple[tuple[int | None, int], ...]


class Prediction(Scored, frozen=True, kw_only=True, gc=False):
    """A prediction as legoworld writes it: a box, a mask or a box in space.

    Amodal: segmentation and bbox of the amodal mask; visible_mask and inmodal_bbox, zeros where
    nothing is visible; the fractions of `Silhouette`, and why those of the whole are None;
    instance: its id in the scene, which others' lists name; occluded_by: what the picture shows in
    its place; directly_occluded_by: the nearest in front; layer and cycle as in `LayerOrder`.
    In space, by Omni3D's names: bbox, the extent of the corners in the picture; center_cam,
    dimensions (width, height, length) and R_cam in metres in the camera frame; depth of the centre;
    truncation, the share of the whole silhouette that is outside the picture, and visibility, the
    share of the rest that nothing hides; None where they are undefined.
    """

    bbox: Box | UnsetType = UNSET
    segmentation: Rle | UnsetType = UNSET
    visible_mask: Rle | UnsetType = UNSET
    inmodal_bbox: Box | UnsetType = UNSET
    occlude_rate: float | UnsetType = UNSET
    visible_of_in_frame: float | UnsetType = UNSET
    in_frame_of_whole: float | UnsetType | None = UNSET
    visible_of_whole: float | UnsetType | None = UNSET
    whole_unknown: Literal["crosses_near_plane", "canvas_too_large"] | UnsetType = UNSET
    instance: int | UnsetType = UNSET
    occluded_by: Occluders | UnsetType = UNSET
    directly_occluded_by: Occluders | UnsetType = UNSET
    layer: int | UnsetType = UNSET
    cycle: tuple[int, ...] | UnsetType = UNSET
    corners: Corners | UnsetType = field(default=UNSET, name="bbox3D")
    center_cam: Point | UnsetType = UNSET
    dimensions: Point | UnsetType = UNSET
    r_cam: tuple[Point, Point, Point] | UnsetType = field(default=UNSET, name="R_cam")
    depth: Number | UnsetType = UNSET
    truncation: Number | UnsetType | None = UNSET
    visibility: Number | UnsetType | None = UNSET
