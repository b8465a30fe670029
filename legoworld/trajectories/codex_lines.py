"""The events of `codex exec --json`: threads, turns and items, one a line.

https://developers.openai.com/codex/noninteractive
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from legoworld.files import Json
from legoworld.records.atif import AtifFinalMetrics, AtifMetrics, AtifResult, AtifToolCall, Content
from legoworld.trajectories.steps import Read, Reading, arguments_of, content_of, rest_of

#: The parts of an item that say what was asked for, of items that are calls in all but name.
_ASKED: Final = {
    "command_execution": ("command",),
    "file_change": ("changes",),
    "web_search": ("query",),
    "todo_list": ("items",),
}
_MESSAGES: Final = ("agent_message", "assistant_message")


def codex_steps(lines: list[Any]) -> Reading:
    """The steps of a Codex transcript.

    An item that was started and never completed (the agent was ended) is a call without a result.
    Tokens are counted a turn: they are a step's where it is the turn's only one, and otherwise no
    step's. The totals have them all.
    """
    reading = Reading()
    open_items: dict[str, dict[str, Any]] = {}
    used, turn_began = [0, 0, 0], 0
    for event in lines:
        kind = event.get("type") if isinstance(event, dict) else None
        item = event.get("item") if isinstance(event, dict) else None
        if kind == "thread.started" and isinstance(event.get("thread_id"), str):
            reading.session_id = event["thread_id"]
            if more := rest_of(event, "type", "thread_id"):
                reading.odd({"type": kind, **more})
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
            reading.odd(event)
    reading.steps += [_step(item) for item in open_items.values()]
    if any(used):
        prompt, cached, completion = used
        reading.total = AtifFinalMetrics(
            total_prompt_tokens=prompt,
            total_cached_tokens=cached,
            total_completion_tokens=completion,
        )
    return reading


def _step(item: dict[str, Any]) -> Read:
    kind = str(item.get("type") or item.get("item_type"))
    more = rest_of(item, "text", "type", "item_type")
    if kind in _MESSAGES:
        return Read(source="agent", message=str(item.get("text", "")), extra={"item": more})
    if kind == "reasoning":
        return Read(source="agent", reasoning=str(item.get("text", "")), extra={"item": more})
    identity = str(item.get("id", ""))
    if kind == "mcp_tool_call":
        call = AtifToolCall(
            tool_call_id=identity,
            function_name=str(item.get("tool")),
            arguments=arguments_of(item.get("arguments")),
            extra={"server": item.get("server")},
        )
        return _called(call, _mcp_result(item), rest_of(more, "tool", "arguments", "server"))
    if kind in _ASKED:
        asked = {key: item[key] for key in _ASKED[kind] if key in item}
        call = AtifToolCall(tool_call_id=identity, function_name=kind, arguments=asked)
        return _called(call, content_of(item.get("aggregated_output")), rest_of(more, *asked))
    return Read(source="system", message=kind, extra={"item": item})


def _called(call: AtifToolCall, content: Content | None, more: Mapping[str, Json]) -> Read:
    step = Read(source="agent", calls=[call])
    more = rest_of(more, "aggregated_output", "id")
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
        return content_of(result.get("content"))
    return content_of(result)


def _add_usage(reading: Reading, event: dict[str, Any], used: list[int], turn_began: int) -> None:
    usage = event.get("usage")
    if not isinstance(usage, dict):
        reading.odd(event)
        return
    counts = [
        int(usage.get(key) or 0) for key in ("input_tokens", "cached_input_tokens", "output_tokens")
    ]
    used[:] = [before + now for before, now in zip(used, counts, strict=True)]
    acting = [step for step in reading.steps[turn_began:] if step.source == "agent"]
    if len(acting) != 1:
        reading.odd(event)
        return
    acting[0].metrics = AtifMetrics(
        prompt_tokens=counts[0],
        cached_tokens=counts[1],
        completion_tokens=counts[2],
        extra={"usage": usage},
    )
    if more := rest_of(event, "type", "usage"):
        reading.odd({"type": "turn.completed", **more})
