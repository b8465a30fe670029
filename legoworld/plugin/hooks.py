"""`legoworld plugin hook`: one program for the hooks of three harnesses.

It reads the ledger and a file of its own beside it, never Blender, so that it answers within any
harness's time. What cannot be judged blocks, where the harness lets it: its caller turns every
error into exit code 2.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

from legoworld.errors import LegoWorldError
from legoworld.plugin.ledger import LedgerBrokenError, read_ledger
from legoworld.plugin.remaining_work import list_unfinished
from legoworld.records.base import UNSET, Record, RecordError, UnsetType, canonical, decode
from legoworld.records.plugin_ledger import Entry, HookMark

Dialect = Literal["claude", "codex", "cursor"]
DIALECTS: Final[tuple[Dialect, ...]] = get_args(Dialect)
MARKS: Final = "hooks.jsonl"
#: Claude Code ends a turn after eight blocked stops in a row; the others get the same.
MOST_BLOCKS: Final = 8
#: What the tools that change a scene are called, or begin with; servers prefix them.
EDITING: Final = ("execute_blender_code", "execute_code", "set_texture")
EDITING_STARTS: Final = ("download_", "import_", "generate_")
_BOM: Final = b"\xef\xbb\xbf"

Event = Literal["before_tool", "after_tool", "stop"]
_EVENTS: Final[dict[str, Event]] = {
    "PreToolUse": "before_tool", "PostToolUse": "after_tool", "Stop": "stop",
    "beforeMCPExecution": "before_tool", "afterMCPExecution": "after_tool", "stop": "stop",
}  # fmt: skip


class HookInputError(LegoWorldError):
    """The harness's input is not a hook event."""

    code = "hook_input"


class _Payload(Record, frozen=True, kw_only=True):
    """The fields used from the three harnesses' input; others are ignored."""

    hook_event_name: str
    tool_name: str | UnsetType = UNSET
    status: str | UnsetType = UNSET
    loop_count: int | UnsetType = UNSET


@dataclass(frozen=True, kw_only=True)
class HookRules:
    """ledger: the case's folder; require_transaction: no editing tool without an open one."""

    dialect: Dialect
    ledger: Path
    require_transaction: bool = False


def hook_answer(rules: HookRules, data: bytes) -> str:
    """Reply to one event, as the harness's JSON. HookInputError if it is not an event."""
    payload, event = _read_payload(data)
    try:
        entries, broken = read_ledger(rules.ledger), None
    except LedgerBrokenError as error:
        entries, broken = [], str(error)
    if event == "stop":
        return canonical(_stop(rules, payload, entries, broken))
    tool = "" if isinstance(payload.tool_name, UnsetType) else payload.tool_name
    if not edits(tool):
        return canonical(_allow(rules.dialect, event))
    why = None
    if event == "before_tool":
        why = broken or _not_declared(rules, entries)
    if why is not None:
        return canonical(_deny(rules.dialect, why))
    _note(rules.ledger, HookMark(ledger_seq=_seq(entries), what="edit", tool=tool))
    return canonical(_allow(rules.dialect, event))


def edits(tool: str) -> bool:
    """Whether a tool may change the scene: `execute_blender_code` of any server, and its like."""
    name = tool.replace(":", "__").rsplit("__", 1)[-1]
    return name in EDITING or name.startswith(EDITING_STARTS)


def _read_payload(data: bytes) -> tuple[_Payload, Event]:
    try:
        payload = decode(_Payload, data.removeprefix(_BOM))
        return payload, _EVENTS[payload.hook_event_name]
    except (RecordError, KeyError) as error:
        raise HookInputError(
            "the input is not a hook event",
            found=str(error),
            expected=f"JSON with hook_event_name, one of {', '.join(_EVENTS)}",
            next_step="let the harness call it: see `legoworld plugin install`",
        ) from error


def _not_declared(rules: HookRules, entries: Sequence[Entry]) -> str | None:
    if rules.require_transaction and (not entries or entries[-1].phase != "open"):
        return "No transaction is open: call begin of legoworld with what the edit may change."
    return None


def _stop(
    rules: HookRules, payload: _Payload, entries: Sequence[Entry], broken: str | None
) -> dict[str, Any]:
    marks = _marks(rules.ledger)
    left = (broken,) if broken is not None else list_unfinished(entries, marks)
    # Cursor also tells of turns that the user ended.
    if not left or payload.status in ("aborted", "error"):
        return {}
    seq = _seq(entries)
    if _blocks_in_a_row(marks, seq) >= MOST_BLOCKS or _is_repeated_stop(payload):
        _note(rules.ledger, HookMark(ledger_seq=seq, what="let_go"))
        if rules.dialect == "cursor":
            return {}
        return {"systemMessage": f"legoworld: the case is not finished. {left[0]}"}
    _note(rules.ledger, HookMark(ledger_seq=seq, what="block"))
    why = "The case of legoworld is not finished. " + " ".join(left)
    if rules.dialect == "cursor":
        return {"followup_message": why}
    return {"decision": "block", "reason": why}


def _is_repeated_stop(payload: _Payload) -> bool:
    return not isinstance(payload.loop_count, UnsetType) and payload.loop_count >= MOST_BLOCKS


def _blocks_in_a_row(marks: Sequence[HookMark], seq: int) -> int:
    """Blocks since the ledger grew last, or since the agent was let go."""
    count = 0
    for mark in reversed(marks):
        if mark.what == "let_go" or mark.ledger_seq != seq:
            break
        count += mark.what == "block"
    return count


def _allow(dialect: Dialect, event: Event) -> dict[str, Any]:
    """No opinion: the harness's own permissions decide; Cursor wants a word before a tool."""
    return {"permission": "allow"} if dialect == "cursor" and event == "before_tool" else {}


def _deny(dialect: Dialect, why: str) -> dict[str, Any]:
    if dialect == "cursor":
        return {"permission": "deny", "user_message": why, "agent_message": why}
    return {
        "hookSpecificOutput": {
            "hookEventName": "PreToolUse",
            "permissionDecision": "deny",
            "permissionDecisionReason": why,
        }
    }


def _seq(entries: Sequence[Entry]) -> int:
    return entries[-1].seq if entries else 0


def _marks(ledger: Path) -> list[HookMark]:
    """Lines that a killed hook left half written, or that are none of ours, count for nothing."""
    path = ledger / MARKS
    marks = []
    for line in path.read_bytes().splitlines() if path.is_file() else []:
        try:
            marks.append(decode(HookMark, line))
        except RecordError:
            continue
    return marks


def _note(ledger: Path, mark: HookMark) -> None:
    """Append a line; hooks of parallel tool calls may do so at the same time."""
    ledger.mkdir(parents=True, exist_ok=True)
    line = (canonical(mark) + "\n").encode()
    descriptor = os.open(
        ledger / MARKS, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644
    )
    try:
        os.write(descriptor, line)
    finally:
        os.close(descriptor)
