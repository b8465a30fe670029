"""Arguments and answers of the plugin's tools; their schemas are what a client is shown."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta

from legoworld.records.base import Record
from legoworld.records.plugin_evidence import (
    CameraEvidence,
    ConstructionPlan,
    DepthEvidence,
    PhotoEvidence,
    Room,
    Sha256,
    Structure,
)
from legoworld.records.plugin_ledger import Judgement, Phase
from legoworld.records.plugin_requirements import Requirement, Result
from legoworld.records.plugin_state import Change


class NoArguments(Record, frozen=True, kw_only=True):
    """A tool without arguments."""


class MeasureArguments(Record, frozen=True, kw_only=True):
    """pictures: also a small picture of each result."""

    requirements: tuple[Requirement, ...]
    pictures: bool = False


class ValidateArguments(Record, frozen=True, kw_only=True):
    """requirements: beside those of committed transactions."""

    requirements: tuple[Requirement, ...] = ()
    pictures: bool = False


class TransactionArguments(Record, frozen=True, kw_only=True):
    """transaction: the number that begin gave; another one than the open transaction is refused."""

    transaction: int | None = None


class HistoryArguments(Record, frozen=True, kw_only=True):
    """last: how many entries."""

    last: Annotated[int, Meta(ge=1)] = 20


class InitializeArguments(Record, frozen=True, kw_only=True):
    """structures: by region, what it shows; without it, the regions' own names say so."""

    structures: dict[str, Structure] | None = None
    camera_height_m: Annotated[
        float, Meta(ge=0.01, le=1000, description="metres, sets the scale")
    ] = 1.5


class PlanArguments(Record, frozen=True, kw_only=True):
    """structures: as in `initialize`."""

    structures: dict[str, Structure] | None = None


class ReviewArguments(Record, frozen=True, kw_only=True):
    """Both or neither: the render that was looked at, and what differs from the photo."""

    render_sha256: Sha256 | None = None
    findings: tuple[str, ...] | None = None


class MoreArguments(Record, frozen=True, kw_only=True):
    """cursor: next_cursor of the answer before."""

    cursor: str


class _Answer(Record, frozen=True, kw_only=True):
    """Nulls and defaults are left out; numbers have six digits.

    scene_signature: of the state that was read last; ledger_seq: the ledger's last entry. notice:
    what was put right meanwhile. next_cursor: the longest list was cut, `more` has the rest.
    """

    scene_signature: str | None
    ledger_seq: int
    notice: str | None = None
    next_cursor: str | None = None


class ShownReport(Record, frozen=True, kw_only=True):
    """results: in the order of the requirements; blocked: a commit would be refused for them."""

    results: tuple[Result, ...]
    blocked: bool


class ReportAnswer(_Answer, frozen=True, kw_only=True):
    """report_sha256: the report in full, as the resource legoworld://reports/SHA256.

    pictures: sha256 of each result's, null without one: legoworld://renders/SHA256.
    """

    report: ShownReport
    report_sha256: str
    pictures: tuple[str | None, ...] | None = None


class CommitAnswer(ReportAnswer, frozen=True, kw_only=True):
    """The judgement of an edit, and the report of its requirements."""

    judgement: Judgement


class BeginAnswer(_Answer, frozen=True, kw_only=True):
    """transaction: its number; unguarded: edits since the last one ended, made without any."""

    transaction: int
    unguarded: tuple[Change, ...]


class StatusAnswer(_Answer, frozen=True, kw_only=True):
    """phase: whether a transaction is open; transaction: the last one's number, 0 before any.

    resumed: an earlier server of this ledger ended with the transaction open.
    """

    phase: Phase
    transaction: int
    resumed: bool


class DiffAnswer(_Answer, frozen=True, kw_only=True):
    """changes: since the open transaction began, by entity."""

    changes: tuple[Change, ...]


class RollbackAnswer(_Answer, frozen=True, kw_only=True):
    """restored: the signature of the scene, which is that of before the transaction."""

    restored: str


class ShownEntry(Record, frozen=True, kw_only=True):
    """A call: its number, its tool, why it failed, and where the case stood after it."""

    seq: int
    tool: str
    error: str | None = None
    phase: Phase
    transaction: int | None = None
    scene_signature: str | None = None


class HistoryAnswer(_Answer, frozen=True, kw_only=True):
    """entries: oldest first."""

    entries: tuple[ShownEntry, ...]


class ShownRegion(Record, frozen=True, kw_only=True):
    """A region of the photo: its pixels and box. category, score, source: of what drew it."""

    name: str
    area_px: int
    bbox_xywh_px: tuple[int, int, int, int]
    category: str | None = None
    score: float | None = None
    source: str


class ShownEvidence(Record, frozen=True, kw_only=True):
    """What the photo says; masks and depth arrays are used by `measure`, and not shown."""

    photo: PhotoEvidence
    regions: tuple[ShownRegion, ...]
    depth: DepthEvidence | None = None
    camera: CameraEvidence


class EvidenceAnswer(_Answer, frozen=True, kw_only=True):
    """evidence: null where the server has none."""

    evidence: ShownEvidence | None


class PlanAnswer(_Answer, frozen=True, kw_only=True):
    """plan: each object's place, extent and relative depth in the photo."""

    plan: ConstructionPlan


class InitializeAnswer(PlanAnswer, frozen=True, kw_only=True):
    """room: as installed. kept: sha256 by file name, readable as resources."""

    room: Room
    kept: dict[str, str]


class ReviewAnswer(_Answer, frozen=True, kw_only=True):
    """render_sha256: of the picture; findings: as noted, null before."""

    render_sha256: str
    findings: tuple[str, ...] | None


class LookAnswer(_Answer, frozen=True, kw_only=True):
    """picture_sha256: of the picture; panes: from left to right; size_wh: of each."""

    picture_sha256: str
    panes: tuple[str, ...]
    size_wh: tuple[int, int]


class ExportAnswer(_Answer, frozen=True, kw_only=True):
    """files: sha256 by name, in the case's folder; warnings: what could not be delivered."""

    files: dict[str, str]
    warnings: tuple[str, ...] = ()


class MoreAnswer(_Answer, frozen=True, kw_only=True):
    """items: more of the list that was cut; place: where the answer has it."""

    place: str
    items: tuple[Any, ...]
