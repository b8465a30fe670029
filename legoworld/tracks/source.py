"""The source of a track: the public half of a dataset in any storage format."""

from __future__ import annotations

from dataclasses import dataclass, field

from legoworld.records.track import CategoryInfo, ImageInfo, Part, Question


@dataclass(frozen=True, kw_only=True)
class Source:
    """The public half of a whole dataset.

    name: of the file or folder; version: of the dataset, "custom" for a user's own; sha256: of the
    files that images and categories were read from; part: the part of the dataset that is present,
    if known; questions: about the images, where there are any; notices: messages for the user.
    """

    name: str
    version: str
    sha256: str
    images: tuple[ImageInfo, ...]
    categories: tuple[CategoryInfo, ...] = ()
    questions: tuple[Question, ...] = ()
    part: Part = field(default_factory=Part)
    notices: tuple[str, ...] = ()
