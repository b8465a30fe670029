"""The formats of `legoworld export`: one row each, what it is written from and by what."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Final, Literal

from legoworld.errors import LegoWorldError


@dataclass(frozen=True, kw_only=True)
class ExportResult:
    """What an export wrote.

    losses: what the format cannot hold of it, as sentences. failed: the errors of scenes that could
    not be read, by name.
    """

    images: int
    annotations: int
    losses: tuple[str, ...] = ()
    failed: Mapping[str, LegoWorldError] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Format:
    """One format.

    run: "module:function" of (run's folder, output, *, track) -> ExportResult; views: of (views:
    Iterable[ExportedView], output: a new folder) -> ExportResult. None where these are no source
    of it. document: of (run or views, output, *, format, track, overwrite) -> what a file of
    both holds, as a value.
    """

    name: str
    run: str | None = None
    views: str | None = None
    document: str | None = None


FORMATS: Final = (
    Format(name="coco", document="legoworld.api.coco_export:export"),
    Format(name="kins", document="legoworld.api.coco_export:export"),
    Format(name="lvis", run="legoworld.api.truth_export:write_lvis"),
    Format(name="panoptic", run="legoworld.api.truth_export:write_panoptic"),
    Format(name="omni3d", run="legoworld.api.boxes3d_export:write_omni3d"),
    Format(
        name="kitti",
        run="legoworld.api.boxes3d_export:write_kitti",
        views="legoworld.exports.kitti:write_views",
    ),
    Format(name="bop", views="legoworld.exports.bop:write_views"),
    Format(name="replicator", views="legoworld.exports.replicator:write_views"),
    Format(name="usd", views="legoworld.exports.usd:write_views"),
)
#: Those that are one COCO JSON, which `export` then gives.
DocumentFormat = Literal["coco", "kins"]
FORMAT_NAMES: Final = tuple(one.name for one in FORMATS)
DEFAULT_FORMAT: Final = FORMAT_NAMES[0]


def find_format(name: str) -> Format:
    """The format of a name of FORMAT_NAMES."""
    return next(one for one in FORMATS if one.name == name)


def writer(name: str) -> Callable[..., Any]:
    """The function that a row names, imported now."""
    module, _, function = name.partition(":")
    found: Callable[..., Any] = getattr(import_module(module), function)
    return found
