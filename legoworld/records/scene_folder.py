"""The JSON files of a scene folder, and verdicts on it.

execution.json: how a scene program ended, and what its own process reports; frozen.json: hashes of
the files a scene consists of; labels.json: categories given to objects and collections beside the
scene; provenance.json: whatever the maker says of how it was made; instances.json: every instance,
seen or not.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from msgspec import Meta

from legoworld.records.base import UNSET, Record, UnsetType


class Verdict(Record, frozen=True, kw_only=True):
    """What a check found. reason: in words, null where all is well."""

    status: str
    code: str
    reason: str | None


OK: Final = Verdict(status="ok", code="ok", reason=None)


#: What a program's process does, in this order.
Stage = Literal["program", "export"]


class ProgramError(Record, frozen=True, kw_only=True):
    """The error that stopped a program; line: of the program itself, null where it has none."""

    type: str
    message: str
    line: Annotated[int, Meta(ge=1, lt=1 << 31)] | None


class Reason(Record, frozen=True, kw_only=True):
    """The parts of an error that left no scene; see LegoWorldError."""

    code: str = ""
    what: str = ""
    found: str = ""
    expected: str = ""
    next: str = ""


class ProgramReport(Record, frozen=True, kw_only=True):
    """What the program's process writes as it goes, and at its end.

    at: the stage that was begun last, null before any; ok: null until the process came to its end;
    reason: why there is no scene; error: what stopped the program; skipped: its own calls that were
    not made.
    """

    at: Stage | None = None
    ok: bool | None = None
    reason: Reason | None = None
    error: ProgramError | None = None
    skipped: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


class Protected(Record, frozen=True, kw_only=True):
    """What the program was kept from, and what another machine would have kept it from."""

    bubblewrap: str | None
    why_not: str | None
    holds: list[str]
    does_not_hold: list[str]


class ExecutionFile(Record, frozen=True, kw_only=True):
    """execution.json. files: sha256 by name; check: how scene.blend opened in another process."""

    schema_version: int | UnsetType = UNSET
    legoworld: str | UnsetType = UNSET
    bpy: str | UnsetType | None = UNSET
    program_sha256: str | UnsetType = UNSET
    status: Literal["complete", "stopped"]
    error: ProgramError | None = None
    files: dict[str, str]
    warnings: tuple[str, ...] = ()
    check: Verdict | UnsetType = UNSET
    sandbox: Protected | UnsetType = UNSET


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


class LabelsFile(Record, frozen=True, kw_only=True):
    """labels.json. An entry has "object" or "collection", and keys ending in "category"."""

    version: Literal[1]
    labels: tuple[dict[str, Any], ...]


#: A JSON object that is copied into run.json as it is; no key of it means anything here.
ProvenanceFile = dict[str, Any]


class InstanceRow(Record, frozen=True, kw_only=True):
    """One instance. objects: the names of the Blender objects it is made of.

    category, category_id: in the vocabulary, None for one without a label; a label without a
    vocabulary has no id. bbox_xywh_px: extents of the
    visible mask, zeros where no pixel shows it; reason: then why not (`view.UNSEEN_REASONS`).
    nested_in: the id of the instance it is labelled inside of.
    """

    id: int
    name: str
    objects: tuple[str, ...]
    category: str | None
    category_id: int | None
    labelled: bool
    area_px: int
    bbox_xywh_px: tuple[int, int, int, int]
    nested_in: int | None
    reason: str | None


class InstancesFile(Record, frozen=True, kw_only=True):
    """instances.json; ids count from 0 and index the values of buffers.npz's `instance`."""

    schema_version: int
    instances: tuple[InstanceRow, ...]
