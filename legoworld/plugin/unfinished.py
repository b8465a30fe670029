"""What is left to do before an agent may finish: read off the ledger and what the hooks saw."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from legoworld.records.plugin_ledger import Entry, HookMark


def unfinished(entries: Sequence[Entry], marks: Sequence[HookMark]) -> tuple[str, ...]:
    """Sentences, the first to do first; none where the agent may finish.

    Nothing is left where nothing was done: no call and no edit.
    """
    return tuple(_left(entries, [m for m in marks if m.what == "edit"]))


def _left(entries: Sequence[Entry], edits: Sequence[HookMark]) -> Iterator[str]:
    if not entries and not edits:
        return
    if entries and entries[-1].phase == "open":
        number = max(e.transaction or 0 for e in entries)
        yield f"Transaction {number} is open: call commit, or rollback."
        return
    report = _last(entries, ("validate", "commit"))
    if report is None:
        yield "Nothing was validated: call validate."
    elif _stale(report, entries, edits):
        yield f"The report of entry {report.seq} is stale, the scene was edited: call validate."
    elif _blocked(report):
        yield f"A hard requirement of entry {report.seq} does not pass: correct it."
    review = _last(entries, ("review",))
    if review is None or _stale(review, entries, edits):
        yield "No render shows the scene as it is: call review and look at the picture."
    elif review.answer["findings"] is None:
        sha256 = review.answer["render_sha256"]
        yield f"The render {sha256} is not reviewed: call review with it and your findings."


def _last(entries: Sequence[Entry], tools: tuple[str, ...]) -> Entry | None:
    return next((e for e in reversed(entries) if e.tool in tools and e.error is None), None)


def _stale(about: Entry, entries: Sequence[Entry], edits: Sequence[HookMark]) -> bool:
    """Whether the scene was edited after a call, as the hooks or a later reading say."""
    edited = any(mark.ledger_seq >= about.seq for mark in edits)
    return edited or entries[-1].scene_signature != about.scene_signature


def _blocked(report: Entry) -> bool:
    answer = report.answer[1] if report.tool == "commit" else report.answer
    return bool(answer["blocked"])
