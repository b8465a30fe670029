"""The plugin's ledger: one JSON line per call, each with the hash of the line before it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta

from legoworld.records.base import Record
from legoworld.records.plugin_evidence import Sha256
from legoworld.records.plugin_requirements import Entity, Requirement
from legoworld.records.plugin_state import Change, ChangeKind

#: Where a case stands.
Phase = Literal["idle", "open"]
Why = Literal["protected", "undeclared", "kind not declared"]


class TransactionLimits(Record, frozen=True, kw_only=True):
    """How much a case may try. The server holds to them, whatever an agent asks for.

    rounds: failed commits of one transaction, after which it has to be rolled back. rollbacks:
    after so many, only a transaction without corrections left is: there is always a way out.
    """

    transactions: Annotated[int, Meta(ge=1)] = 8
    rollbacks: Annotated[int, Meta(ge=0)] = 2
    rounds: Annotated[int, Meta(ge=0)] = 2


class Declaration(Record, frozen=True, kw_only=True):
    """What an edit is about, said before it.

    editable, protected: objects with their children, or collections, by name; whatever is neither
    may not change, and a name in both is protected. New objects are editable by their own name or
    that of a parent or collection. kinds: what may change; requirements: what has to hold after it.
    """

    editable: Annotated[tuple[Entity, ...], Meta(min_length=1, max_length=1000)]
    protected: tuple[Entity, ...] = ()
    kinds: Annotated[tuple[ChangeKind, ...], Meta(min_length=1)]
    requirements: tuple[Requirement, ...] = ()


class Violation(Record, frozen=True, kw_only=True):
    """A change that the declaration does not allow, and why."""

    change: Change
    why: Why


class Worse(Record, frozen=True, kw_only=True):
    """A requirement that an edit made worse than its rule allows: its residuals."""

    requirement: Requirement
    before: float | None
    after: float | None


class Judgement(Record, frozen=True, kw_only=True):
    """What a transaction did, and whether it may be committed.

    worse: what holds less well than when it began; blocked: something does, or the report is.
    accepted: at least one allowed change, no violation, and not blocked.
    """

    allowed: tuple[Change, ...]
    violations: tuple[Violation, ...]
    worse: tuple[Worse, ...] = ()
    blocked: bool
    accepted: bool


class Entry(Record, frozen=True, kw_only=True):
    """One line of ledger.jsonl.

    seq: from 1; previous: sha256 of the line before, 64 zeros for the first; tool: the tool that
    was called; request: its arguments; answer: what it returned, null where the call failed; error:
    why it failed; phase, transaction: where the case stands after it; geometry_signature,
    scene_signature: of the last state that was read, null before any; base_sha256: of the stored
    copy that a rollback restores, null before any transaction. sha256: of the line without it.
    """

    seq: Annotated[int, Meta(ge=1)]
    previous: Sha256
    tool: str
    request: dict[str, Any]
    answer: Any
    error: str | None
    phase: Phase
    transaction: Annotated[int, Meta(ge=1)] | None
    geometry_signature: Sha256 | None
    scene_signature: Sha256 | None
    base_sha256: Sha256 | None
    sha256: str = ""


class Review(Record, frozen=True, kw_only=True):
    """A render of the live scene, and what was seen in it.

    findings: null while nobody has said what they saw.
    """

    render_sha256: Sha256
    findings: tuple[str, ...] | None


class Export(Record, frozen=True, kw_only=True):
    """What `export` wrote: sha256 by file name; warnings: what could not be delivered, in words."""

    files: dict[str, Sha256]
    warnings: tuple[str, ...]


class HookMark(Record, frozen=True, kw_only=True):
    """One line of hooks.jsonl beside the ledger: what a hook saw or did.

    ledger_seq: the ledger's last line at that time. edit: a tool may have changed the scene; block:
    the agent was kept from finishing; let_go: it was not, though work was left.
    """

    ledger_seq: Annotated[int, Meta(ge=0)]
    what: Literal["edit", "block", "let_go"]
    tool: str | None = None
