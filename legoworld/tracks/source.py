"""What a track is made from: the public half of a dataset, whatever it is kept in."""

from __future__ import annotations

from dataclasses import dataclass, field

from legoworld.records.track import CategoryInfo, ImageInfo, Part


@dataclass(frozen=True, kw_only=True)
class Source:
    """The public half of a whole dataset.

    name: of the file or folder; version: of the dataset, "custom" for one of the user's own;
    sha256: of what images and categories were read from; part: what of the dataset is
    there, where that is known; notices: what a user should be told.
    """

    name: str
    version: str
    sha256: str
    images: tuple[ImageInfo, ...]
    categories: tuple[CategoryInfo, ...] = ()
    part: Part = field(default_factory=Part)
    notices: tuple[str, ...] = ()
