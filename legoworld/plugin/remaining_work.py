"""What is left to do before an agent may finish: read off the ledger and what the hooks saw."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from legoworld.records.base import to_record
from legoworld.records.plugin_ledger import Declaration, Entry, HookMark
from legoworld.records.plugin_requirements import Requirement


def standing_requirements(entries: Sequence[Entry]) -> tuple[Requirement, ...]:
    """The requirements of all committed transactions, in their order, each once."""
    requirements: dict[Requirement, None] = {}
    declared: tuple[Requirement, ...] = ()
    for entry in entries:
        if entry.error is not None:
            continue
        if entry.tool == "begin":
            declared = to_record(Declaration, entry.request).requirements
        if entry.tool == "commit" and entry.phase == "idle":
            requirements.update(dict.fromkeys(declared))
    return tuple(requirements)


def list_unfinished(entries: Sequence[Entry], marks: Sequence[HookMark]) -> tuple[str, ...]:
    """Remaining steps as sentences, in order; empty if the agent may finish.

    Nothing is left where nothing was done: no call and no edit.
    """
    calls = [entry for entry in entries if entry.tool != "serve"]
    return tuple(_list_remaining(calls, [m for m in marks if m.what == "edit"]))


def _list_remaining(entries: Sequence[Entry], edits: Sequence[HookMark]) -> Iterator[str]:
    if not entries and not edits:
        return
    if entries and entries[-1].phase == "open":
        number = max(e.transaction or 0 for e in entries)
        yield f"Transaction {number} is open: call commit, or rollback."
        return
    report = _last_report(entries)
    if report is None:
        yield "Nothing was validated: call validate."
    elif _stale(report, entries, edits):
        yield f"The report of entry {report.seq} is stale, the scene was edited: call validate."
    elif _is_blocked(report):
        yield f"A hard requirement of entry {report.seq} does not pass: correct it."
    review = _last(entries, ("review",))
    if review is None or _stale(review, entries, edits):
        yield "No render shows the scene as it is: call review and look at the picture."
    elif review.answer["findings"] is None:
        sha256 = review.answer["render_sha256"]
        yield f"The render {sha256} is not reviewed: call review with it and your findings."


def _last_report(entries: Sequence[Entry]) -> Entry | None:
    """The last validate, or commit that measured all that is required by then.

    A commit measures its own requirements: it may break an earlier transaction's.
    """
    for number, entry in reversed(list(enumerate(entries, start=1))):
        if entry.error is None and entry.tool == "validate":
            return entry
        if entry.error is None and entry.tool == "commit":
            begun = _last(entries[:number], ("begin",))
            own = () if begun is None else to_record(Declaration, begun.request).requirements
            if set(standing_requirements(entries[:number])) <= set(own):
                return entry
    return None


def _last(entries: Sequence[Entry], tools: tuple[str, ...]) -> Entry | None:
    return next((e for e in reversed(entries) if e.tool in tools and e.error is None), None)


def _stale(about: Entry, entries: Sequence[Entry], edits: Sequence[HookMark]) -> bool:
    """Whether the scene was edited after a call, as the hooks or a later reading say."""
    edited = any(mark.ledger_seq >= about.seq for mark in edits)
    return edited or entries[-1].scene_signature != about.scene_signature


def _is_blocked(report: Entry) -> bool:
    answer = report.answer[1] if report.tool == "commit" else report.answer
    return bool(answer["blocked"])
