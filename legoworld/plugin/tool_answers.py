"""Answers of the tools: short, with the state they are about, and cut where they are too long."""

from __future__ import annotations

from typing import Any, Final

import msgspec

from legoworld.errors import UsageError
from legoworld.files import Json, canonical_json
from legoworld.plugin.case import Case
from legoworld.records.base import readable
from legoworld.records.plugin_calls import ShownReport
from legoworld.records.plugin_requirements import Report

JsonObject = dict[str, Any]

#: Characters of an answer, some 6,000 tokens; a longer one is cut in its longest list.
MOST_CHARACTERS: Final = 24_000
#: Of them for what stands around the items of a page.
_AROUND: Final = 400
_MOST_DIGITS: Final = 18
_SHOWN: Final = 80
_DIGITS: Final = 6


def answer_state(case: Case) -> JsonObject:
    """What every answer has: signature of the last state that was read, last line of the ledger."""
    entries = case.ledger.entries
    state: JsonObject = {
        "scene_signature": entries[-1].scene_signature if entries else None,
        "ledger_seq": entries[-1].seq if entries else 0,
    }
    if recovered := case.live and case.live.recovered:
        state["notice"] = (
            f"a rollback had ended early: {recovered} is your file again; what the rollback had "
            "saved under that name is beside it"
        )
    return state


def answer_report(case: Case, report: Report) -> JsonObject:
    """A report as answers show it, and where it is in full."""
    return {
        "report": ShownReport(results=report.results, blocked=report.blocked),
        "report_sha256": case.artefacts.keep(readable(report).encode(), "json"),
    }


def brief(value: msgspec.Struct | Json) -> Any:
    """A record as JSON without nulls and defaults, its numbers to six digits."""
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}")
    if isinstance(value, msgspec.Struct):
        config = value.__struct_config__
        made: JsonObject = {} if config.tag is None else {str(config.tag_field): config.tag}
        for field in msgspec.structs.fields(value):
            if (own := getattr(value, field.name)) != field.default:
                made[field.name] = own
        return brief(made)
    if isinstance(value, dict):
        return {key: brief(item) for key, item in value.items() if item is not None}
    return [brief(item) for item in value] if isinstance(value, list | tuple) else value


def cut_answer(case: Case, answer: JsonObject) -> JsonObject:
    """An answer of at most `MOST_CHARACTERS`; the rest of its longest list is kept for `more`."""
    lists = _lists(answer, "")
    beyond = len(canonical_json(answer)) - MOST_CHARACTERS
    if beyond <= 0 or not lists:
        return answer
    size, holder, key, place = max(lists, key=lambda found: found[0])
    items = holder[key]
    cut = _fitting(items, size - beyond)
    holder[key] = items[:cut]
    kept = case.artefacts.keep(canonical_json({"place": place, "items": items}).encode(), "json")
    return {**answer, "next_cursor": f"{kept}.{cut}"}


def page_start(text: str, argument: str) -> int:
    """Where a page begins, by a cursor's number. UsageError naming the argument for another text.

    Python refuses to read numbers of 4,300 digits; no list is as long as one of 18.
    """
    if text.isascii() and text.isdecimal() and len(text) <= _MOST_DIGITS:
        return int(text)
    raise UsageError(
        f"{argument} names no page",
        found=repr(text[:_SHOWN]),
        expected="next_cursor of an answer",
    )


def answer_page(kept: JsonObject, sha256: str, start: int) -> JsonObject:
    """The items of a list from a place on, as many as fit."""
    items = kept["items"][start:]
    cut = _fitting(items, MOST_CHARACTERS - _AROUND)
    page: JsonObject = {"place": kept["place"], "items": tuple(items[:cut])}
    return page if cut == len(items) else {**page, "next_cursor": f"{sha256}.{start + cut}"}


def _fitting(items: list[Json], characters: int) -> int:
    """How many of some items fit, at least one."""
    for n, item in enumerate(items):
        characters -= len(canonical_json(item)) + 1
        if characters < 0:
            return max(1, n)
    return len(items)


def _lists(value: JsonObject, place: str) -> list[tuple[int, JsonObject, str, str]]:
    """All lists in objects: characters, what holds each, its key, and its place."""
    found: list[tuple[int, JsonObject, str, str]] = []
    for key, item in value.items():
        if isinstance(item, list):
            found.append((len(canonical_json(item)), value, key, f"{place}{key}"))
        elif isinstance(item, dict):
            found += _lists(item, f"{place}{key}.")
    return found
