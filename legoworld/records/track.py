"""A track's file: COCO "image info" JSON, the public half of a dataset, with its questions.

`Probe`, of a private track alone: how a submission of bench-x is looked at besides its picture.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from msgspec import Meta

from legoworld.records.base import UNSET, Record, UnsetType

Box = tuple[int | float, int | float, int | float, int | float]
Which = Literal["", "leftmost", "rightmost", "closest", "farthest"]


class Designator(Record, frozen=True, kw_only=True):
    """A thing as a question names it. which: among several of its category."""

    category: str
    which: Which = ""


Kind = Literal["yes_no", "choice", "count", "number", "refer"]
Answered = bool | int | float | str | Box


class Question(Record, frozen=True, kw_only=True):
    """One question about a picture, without its answer.

    kind: of the answer: true or false, one of the options, a whole number, metres, or a box x, y,
    width, height in pixels. relation: what is asked; a, b: the things it names; options: what a
    choice is among. any: whether it holds of any two things of these categories; frame: an object's
    own frame of reference, UNSET for the picture's.
    """

    id: str
    image_id: int
    kind: Kind
    relation: str
    text: str
    a: Designator
    b: Designator | None = None
    options: tuple[Designator, ...] = ()
    any: bool | UnsetType = UNSET
    frame: str | UnsetType = UNSET


class ShownQuestion(Record, frozen=True, kw_only=True):
    """A question as a page shows it. boxes: of the things it names, where they are known."""

    id: str
    text: str
    truth: str
    answer: str
    score: float | None
    boxes: tuple[Box, ...]


#: Ids above 2**53 lose digits where JSON numbers are read as doubles.
LARGEST_ID: Final = 2**53
Id = Annotated[int, Meta(ge=0, le=LARGEST_ID)]
Pixels = Annotated[int, Meta(ge=1)]


class Private(Record, frozen=True, kw_only=True):
    """Keys that only ground truth has: a file or an image with one of them is no track's."""

    annotations: Any = UNSET
    segmentation: Any = UNSET
    bbox: Any = UNSET
    area: Any = UNSET
    iscrowd: Any = UNSET


PRIVATE_KEYS: Final = Private.__struct_fields__


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


class ImageInfo(Private, frozen=True, kw_only=True):
    """One photo. LVIS v1 names it by coco_url alone; hfov_deg: a bench's, probe: private."""

    id: Id
    width: Pixels
    height: Pixels
    file_name: str | UnsetType = UNSET
    coco_url: str | UnsetType | None = UNSET
    hfov_deg: Annotated[float, Meta(gt=0, lt=180)] | UnsetType = UNSET
    probe: Probe | UnsetType = UNSET


class CategoryInfo(Record, frozen=True, kw_only=True):
    """One category, without an LVIS one's counts of annotated images and instances.

    isthing: of panoptic categories, 0 for stuff.
    """

    id: Id
    name: str
    supercategory: str | UnsetType | None = UNSET
    synset: str | UnsetType | None = UNSET
    synonyms: tuple[str, ...] | UnsetType | None = UNSET
    frequency: str | UnsetType | None = UNSET
    isthing: Literal[0, 1] | UnsetType = UNSET


class TrackFile(Private, frozen=True, kw_only=True):
    """TRACK.json from any source. info: anything."""

    images: Annotated[tuple[ImageInfo, ...], Meta(min_length=1)]
    categories: tuple[CategoryInfo, ...] | None = None
    info: dict[str, Any] | None = None
    questions: tuple[Question, ...] = ()


class Part(Record, frozen=True, kw_only=True):
    """What part of a dataset of depth is there. scenes: how many of its images each has."""

    dataset: str | UnsetType = UNSET
    dataset_images: int | UnsetType = UNSET
    scenes: dict[str, int] | UnsetType = UNSET
    scenes_left_out: dict[str, int] | UnsetType = UNSET
    photos_left_out: tuple[str, ...] | UnsetType = UNSET


class TrackInfo(Part, frozen=True, kw_only=True):
    """The info of a track that `legoworld track make` made. sample: null for all or the chosen."""

    description: str
    task: str
    dataset_version: str
    source: str
    source_sha256: str
    source_images: int
    sample: int | None
    seed: int | None
    chosen: bool


class MadeTrack(Record, frozen=True, kw_only=True):
    """TRACK.json as `legoworld track make` makes it."""

    info: TrackInfo
    images: tuple[ImageInfo, ...]
    categories: tuple[CategoryInfo, ...]
    questions: tuple[Question, ...] | UnsetType = UNSET


class ListedImage(Record, frozen=True, kw_only=True):
    """One image of datasets/eth3d/images.json."""

    id: Id
    file_name: str
