"""The tracks of a family: what of its ground truth is public."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from legoworld.errors import UsageError
from legoworld.tasks.registry import find_family
from legoworld.tracks.track import Source


@dataclass(frozen=True, kw_only=True)
class TrackFamily:
    """How tracks are made of truths of one kind.

    source: the public half of a task's truth, by the options that were given. options: those it
    takes. CatalogError or TruthInvalidError for unusable truth. declared: the options that say
    what a folder's files hold, which `declare` writes into it; it returns the file's name and text,
    None where it said so already.
    """

    source: Callable[[str, Path, Mapping[str, Any]], Source]
    options: frozenset[str] = frozenset()
    declared: frozenset[str] = frozenset()
    declare: Callable[[Path, Mapping[str, str | None]], tuple[str, str] | None] | None = None


def load_track_family(task: str) -> TrackFamily:
    """The track making of a task. UsageError where tracks of it are not made from truth."""
    family = find_family(task)
    if family.track is None:
        raise UsageError(f"tracks of {task} are not made from ground truth", found=task)
    return family.load("track", TrackFamily)
