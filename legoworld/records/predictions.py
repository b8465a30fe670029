"""One prediction: an entry of predictions.json, and a line of the files it is divided into."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.track import Id

# gc=False: none can be part of a cycle, and there are millions.

Number = int | float
#: x, y, width, height in pixels.
Box = tuple[Number, Number, Number, Number]


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


#: Instances, None for all unlabelled geometry together, and pixels at which each hides another.
Occluders = tuple[tuple[int | None, int], ...]


class Prediction(Scored, frozen=True, kw_only=True, gc=False):
    """A prediction as legoworld writes it: a box or a mask.

    Amodal: segmentation and bbox of the amodal mask; visible_mask and inmodal_bbox, zeros where
    nothing is visible; the fractions of `Silhouette`, and why those of the whole are None;
    instance: its id in the scene, which others' lists name; occluded_by: what the picture shows in
    its place; directly_occluded_by: the nearest in front; layer and cycle as in `LayerOrder`.
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
