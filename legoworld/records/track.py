"""A track's file: COCO "image info" JSON, the public half of a dataset."""

from __future__ import annotations

from typing import Annotated, Any, Final

from msgspec import Meta, field

from legoworld.records.base import UNSET, Record, UnsetType

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


class ImageInfo(Private, frozen=True, kw_only=True):
    """One photo. LVIS v1 names it by coco_url alone."""

    id: Id
    width: Pixels
    height: Pixels
    file_name: str | UnsetType = UNSET
    coco_url: str | None = None


class CategoryInfo(Record, frozen=True, kw_only=True):
    """One category; an LVIS one has synonyms and a frequency."""

    id: Id
    name: str
    synonyms: tuple[str, ...] | None = None


class TrackFile(Private, frozen=True, kw_only=True):
    """TRACK.json. info: what `legoworld track make` says of its source, or anything."""

    images: Annotated[tuple[ImageInfo, ...], Meta(min_length=1)]
    categories: tuple[CategoryInfo, ...] | None = None
    info: dict[str, Any] | None = field(default_factory=dict)
