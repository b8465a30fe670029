"""frozen.json: hashes of the files a scene consists of, and verdicts; and what freezing it said."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.verdict import Verdict


class HashedFile(Record, frozen=True, kw_only=True):
    """What identifies a file's content."""

    sha256: str
    bytes: Annotated[int, Meta(ge=0)]


class FrozenFile(Record, frozen=True, kw_only=True):
    """frozen.json. Files by their path relative to the scene folder; null: it was not there.

    bpy: the version that opened scene.blend; covers: the artefacts the record was made with, there
    or not.
    """

    schema_version: int | UnsetType = UNSET
    legoworld: str | UnsetType = UNSET
    bpy: str | UnsetType | None = UNSET
    status: str
    checks: dict[str, Verdict] | UnsetType = UNSET
    covers: tuple[str, ...] = ()
    files: dict[str, HashedFile | None]
    dependencies: dict[str, HashedFile | None]


class FrozenRow(Record, frozen=True, kw_only=True):
    """What `legoworld freeze --json` prints of a scene. checks: by the artefact's name."""

    scene: str
    status: str
    checks: dict[str, Verdict]
    warnings: list[str]
