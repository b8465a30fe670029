"""LVIS's annotations, as far as they say which categories were verified on each image."""

from __future__ import annotations

from legoworld.records.base import Record


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
