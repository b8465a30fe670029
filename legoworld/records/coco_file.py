"""Files in COCO's form: what `legoworld export --format coco` writes, view/, and two of others.

view/ of an evaluation of boxes or masks: what a report draws over the photos; private, as truth is.
Those of others are LVIS's verified categories, and panopticapi's JSON (ground truth, or answers),
of which a folder has the PNGs.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, field

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.predictions import Box, Corners, Number, Point, Prediction, Rle
from legoworld.records.track import CategoryInfo, Id, ImageInfo

#: A mask, or polygons of x, y, x, y, ...
Segmentation = Rle | tuple[tuple[Number, ...], ...]


class CocoInfo(Record, frozen=True, kw_only=True):
    """Where the predictions come from. images_without_result: ids of images that were not read."""

    description: str
    task: str
    vocabulary_sha256: str
    images_without_result: tuple[int, ...]


class CocoImage(Record, frozen=True, kw_only=True):
    """A photo. neg_category_ids, not_exhaustive_category_ids: of LVIS, what was verified on it."""

    id: int
    file_name: str
    width: int
    height: int
    neg_category_ids: tuple[int, ...] | UnsetType = UNSET
    not_exhaustive_category_ids: tuple[int, ...] | UnsetType = UNSET


class CocoCategory(Record, frozen=True, kw_only=True):
    """A category. frequency: of LVIS, the group it is averaged in."""

    id: int
    name: str
    frequency: str | UnsetType = UNSET


class ObjectNames(Record, frozen=True, kw_only=True):
    """Of a scene's prediction: the label's owner, and the objects whose surfaces it has."""

    name: str | UnsetType = UNSET
    objects: tuple[str, ...] | UnsetType = UNSET


class CocoAnnotation(Record, frozen=True, kw_only=True):
    """A prediction as an annotation: its mask as compressed RLE, none for a box.

    area: the mask's pixels, or the box's. inmodal_seg to occlude_rate: of an amodal mask, as KINS
    and D2SA call them: its visible part, and pixels of both. attributes: name and objects of a
    scene's instance.
    """

    id: int
    image_id: int
    category_id: int
    bbox: Box
    area: float
    segmentation: Segmentation
    iscrowd: int
    score: Number
    inmodal_seg: Segmentation | UnsetType = UNSET
    inmodal_bbox: Box | UnsetType = UNSET
    a_area: float | UnsetType = UNSET
    i_area: float | UnsetType = UNSET
    occlude_rate: float | UnsetType = UNSET
    attributes: ObjectNames | UnsetType = UNSET


class CocoFile(Record, frozen=True, kw_only=True):
    """A COCO JSON."""

    info: CocoInfo
    images: tuple[CocoImage, ...]
    annotations: tuple[CocoAnnotation, ...]
    categories: tuple[CocoCategory, ...]


class VerifiedImage(Record, frozen=True, kw_only=True):
    """An image and the categories known to be absent from it."""

    id: int
    neg_category_ids: tuple[int, ...]


class VerifiedAnnotation(Record, frozen=True, kw_only=True):
    """That a category is on an image."""

    image_id: int
    category_id: int


class VerifiedTruth(Record, frozen=True, kw_only=True):
    """Everything that was verified."""

    images: tuple[VerifiedImage, ...]
    annotations: tuple[VerifiedAnnotation, ...]


class SegmentInfo(Record, frozen=True, kw_only=True):
    """One segment. area: of the truth; of an answer the PNG decides."""

    id: Annotated[int, Meta(ge=1, lt=1 << 24)]
    category_id: int
    area: int = 0
    iscrowd: Literal[0, 1] = 0


class PanopticAnnotation(Record, frozen=True, kw_only=True):
    """One image. file_name: of its PNG, below the folder."""

    image_id: Id
    file_name: str
    segments_info: tuple[SegmentInfo, ...]


class PanopticAnswers(Record, frozen=True, kw_only=True):
    """Somebody's answers."""

    annotations: tuple[PanopticAnnotation, ...]


class PanopticTruthFile(PanopticAnswers, frozen=True, kw_only=True):
    """Ground truth, such as panoptic_val2017.json."""

    images: Annotated[tuple[ImageInfo, ...], Meta(min_length=1)]
    categories: Annotated[tuple[CategoryInfo, ...], Meta(min_length=1)]


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
