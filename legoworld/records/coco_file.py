"""What `legoworld export --format coco` writes: a whole dataset file of predictions."""

from __future__ import annotations

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.evaluation_view import Segmentation
from legoworld.records.predictions import Box, Number


class CocoInfo(Record, frozen=True, kw_only=True):
    """Where the predictions come from. images_without_result: ids of images that were not read."""

    description: str
    task: str
    vocabulary_sha256: str
    images_without_result: tuple[int, ...]


class CocoImage(Record, frozen=True, kw_only=True):
    """A photo."""

    id: int
    file_name: str
    width: int
    height: int


class CocoCategory(Record, frozen=True, kw_only=True):
    """A category."""

    id: int
    name: str


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
