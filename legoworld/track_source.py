"""What a track is made from: the public half of a dataset, whatever it is kept in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Source:
    """The public half of a whole dataset.

    name: of the file or folder; version: of the dataset, "custom" for one of the user's own;
    sha256: of what images and categories were read from; about: more for a track's info, such as
    what part of the dataset is there; notices: what a user should be told.
    """

    name: str
    version: str
    sha256: str
    images: list[dict[str, Any]]
    categories: list[dict[str, Any]]
    about: Mapping[str, Any] = field(default_factory=dict)
    notices: tuple[str, ...] = ()
