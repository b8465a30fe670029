"""What run.json says of each photo that a baseline predicted, or that was imported."""

from __future__ import annotations

from typing import Any

from legoworld.records.base import UNSET, Record, UnsetType


class ImportedFrom(Record, frozen=True, kw_only=True):
    """The file a result was taken from. matched_by: the rule by which its name is the photo's."""

    file: str
    sha256: str | UnsetType = UNSET
    matched_by: str | UnsetType = UNSET


class ReadArray(Record, frozen=True, kw_only=True):
    """What of an imported file was read. array: its name in an .npz or .exr."""

    array: str | None
    dtype: str
    shape: tuple[int, ...]


class PhotoEntry(Record, frozen=True, kw_only=True):
    """One photo of a baseline's run: predicted from these bytes on this machine, or imported."""

    photo_sha256: str | UnsetType = UNSET
    environment: dict[str, Any] | UnsetType = UNSET
    source: ImportedFrom | UnsetType = UNSET
    read: ReadArray | UnsetType = UNSET
