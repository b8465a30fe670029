"""The events of `codex exec --json`: threads, turns and items, one a line.

https://developers.openai.com/codex/noninteractive
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from legoworld.files import Json
from legoworld.records.atif import AtifFinalMetrics, AtifMetrics, AtifResult, AtifToolCall, Content
from legoworld.trajectories.steps import (
    ParsedStep,
    ParsedTranscript,
    parse_arguments,
    parse_content,
    remaining_fields,
)

#: The parts of an item that say what was asked for, of items that are calls in all but name.
_ASKED: Final = {
    "command_execution": ("command",),
    "file_change": ("changes",),
    "web_search": ("query",),
    "todo_list": ("items",),
}
_MESSAGES: Final = ("agent_message", "assistant_message")


def codex_steps(lines: list[Any]) -> ParsedTranscript:
    """The steps of a Codex transcript.

    An item that was started and never completed (the agent was ended) is a call without a result.
    Tokens are counted a turn: they are a step's where it is the turn's only one, and otherwise no
    step's. The totals have them all.
    """
    reading = ParsedTranscript()
    open_items: dict[str, dict[str, Any]] = {}
    used, turn_began = [0, 0, 0], 0
    for event in lines:
        kind = event.get("type") if isinstance(event, dict) else None
        item = event.get("item") if isinstance(event, dict) else None
        if kind == "thread.started" and isinstance(event.get("thread_id"), str):
            reading.session_id = event["thread_id"]
            if more := remaining_fields(event, "type", "thread_id"):
                reading.keep_unknown({"type": kind, **more})
        elif kind in ("item.started", "item.updated") and isinstance(item, dict):
            open_items[str(item.get("id"))] = item
        elif kind == "item.completed" and isinstance(item, dict):
            begun = open_items.pop(str(item.get("id")), {})
            reading.steps.append(_step({**begun, **item}))
        elif kind == "turn.completed":
            _add_usage(reading, event, used, turn_began)
            turn_began = len(reading.steps)
        elif kind == "turn.started" and set(event) == {"type"}:
            continue
        else:
            reading.keep_unknown(event)
    reading.steps += [_step(item) for item in open_items.values()]
    if any(used):
        prompt, cached, completion = used
        reading.total = AtifFinalMetrics(
            total_prompt_tokens=prompt,
            total_cached_tokens=cached,
            total_completion_tokens=completion,
        )
    return reading


def _step(item: dict[str, Any]) -> ParsedStep:
    kind = str(item.get("type") or item.get("item_type"))
    more = remaining_fields(item, "text", "type", "item_type")
    if kind in _MESSAGES:
        return ParsedStep(source="agent", message=str(item.get("text", "")), extra={"item": more})
    if kind == "reasoning":
        return ParsedStep(source="agent", reasoning=str(item.get("text", "")), extra={"item": more})
    identity = str(item.get("id", ""))
    if kind == "mcp_tool_call":
        call = AtifToolCall(
            tool_call_id=identity,
            function_name=str(item.get("tool")),
            arguments=parse_arguments(item.get("arguments")),
            extra={"server": item.get("server")},
        )
        return _call_step(
            call, _mcp_result(item), remaining_fields(more, "tool", "arguments", "server")
        )
    if kind in _ASKED:
        asked = {key: item[key] for key in _ASKED[kind] if key in item}
        call = AtifToolCall(tool_call_id=identity, function_name=kind, arguments=asked)
        return _call_step(
            call, parse_content(item.get("aggregated_output")), remaining_fields(more, *asked)
        )
    return ParsedStep(source="system", message=kind, extra={"item": item})


def _call_step(call: AtifToolCall, content: Content | None, more: Mapping[str, Json]) -> ParsedStep:
    step = ParsedStep(source="agent", calls=[call])
    more = remaining_fields(more, "aggregated_output", "id")
    if content is not None or more.get("status") in ("completed", "failed"):
        result = AtifResult(
            source_call_id=call.tool_call_id,
            content=content,
            extra={"is_error": more.get("status") == "failed"},
        )
        step.results = [result]
    step.extra = {"item": more} if more else {}
    return step


def _mcp_result(item: dict[str, Any]) -> Content | None:
    result, error = item.get("result"), item.get("error")
    if isinstance(error, dict) and "message" in error:
        return str(error["message"])
    if isinstance(result, dict):
        return parse_content(result.get("content"))
    return parse_content(result)


def _add_usage(
    reading: ParsedTranscript, event: dict[str, Any], used: list[int], turn_began: int
) -> None:
    usage = event.get("usage")
    if not isinstance(usage, dict):
        reading.keep_unknown(event)
        return
    counts = [
        int(usage.get(key) or 0) for key in ("input_tokens", "cached_input_tokens", "output_tokens")
    ]
    used[:] = [before + now for before, now in zip(used, counts, strict=True)]
    acting = [step for step in reading.steps[turn_began:] if step.source == "agent"]
    if len(acting) != 1:
        reading.keep_unknown(event)
        return
    acting[0].metrics = AtifMetrics(
        prompt_tokens=counts[0],
        cached_tokens=counts[1],
        completion_tokens=counts[2],
        extra={"usage": usage},
    )
    if more := remaining_fields(event, "type", "usage"):
        reading.keep_unknown({"type": "turn.completed", **more})
