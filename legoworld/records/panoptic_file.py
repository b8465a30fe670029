"""JSON of panopticapi: ground truth, or somebody's answers, of which a folder has the PNGs."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from legoworld.records.base import Record
from legoworld.records.track import CategoryInfo, Id, ImageInfo


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
