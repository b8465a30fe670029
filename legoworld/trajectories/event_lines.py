"""The events of Codex (exec --json), Gemini CLI (stream-json) and OpenCode (--format json).

https://developers.openai.com/codex/noninteractive, https://geminicli.com/docs/cli/headless/,
https://opencode.ai/docs/cli/
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


def gemini_steps(lines: list[Any]) -> ParsedTranscript:
    """The steps of a Gemini CLI transcript: init, message, tool_use, tool_result, result.

    The pieces of a streamed message (`delta`) are one step, up to the next event of another kind.
    """
    reading = ParsedTranscript()
    of_call: dict[str, ParsedStep] = {}
    streamed: ParsedStep | None = None
    for event in lines:
        kind = event.get("type") if isinstance(event, dict) else None
        if kind == "message" and event.get("role") in ("assistant", "model"):
            last = reading.steps[-1] if reading.steps else None
            if last is not None and last is streamed and event.get("delta"):
                last.message = f"{last.message}{parse_content(event.get('content')) or ''}"
                continue
            reading.steps.append(
                ParsedStep(
                    source="agent",
                    message=parse_content(event.get("content")) or "",
                    timestamp=event.get("timestamp"),
                    extra={
                        "event": remaining_fields(event, "type", "role", "content", "timestamp")
                    },
                )
            )
            streamed = reading.steps[-1] if event.get("delta") else None
        elif kind == "tool_use" and isinstance(event.get("tool_id"), str):
            call = AtifToolCall(
                tool_call_id=event["tool_id"],
                function_name=str(event.get("tool_name")),
                arguments=parse_arguments(event.get("parameters")),
            )
            step = ParsedStep(source="agent", calls=[call], timestamp=event.get("timestamp"))
            more = remaining_fields(
                event, "type", "tool_id", "tool_name", "parameters", "timestamp"
            )
            step.extra = {"event": more} if more else {}
            of_call[call.tool_call_id] = step
            reading.steps.append(step)
        elif kind == "tool_result" and str(event.get("tool_id")) in of_call:
            said = parse_content(event.get("output"))
            more = remaining_fields(event, "type", "tool_id", "output")
            failed = event.get("status") == "error"
            of_call[event["tool_id"]].results.append(
                AtifResult(
                    source_call_id=event["tool_id"],
                    content=said,
                    extra={"is_error": failed, "event": more},
                )
            )
        else:
            if kind == "init":
                reading.session_id, reading.model = event.get("session_id"), event.get("model")
            if kind == "result" and isinstance(event.get("stats"), dict):
                stats = event["stats"]
                reading.total = AtifFinalMetrics(
                    total_prompt_tokens=stats.get("input_tokens"),
                    total_completion_tokens=stats.get("output_tokens"),
                    total_cached_tokens=stats.get("cached"),
                )
            reading.keep_unknown(event)
    return reading


def opencode_steps(lines: list[Any]) -> ParsedTranscript:
    """The steps of an OpenCode transcript: text, tool_use and step_finish, each with a part."""
    reading = ParsedTranscript()
    for event in lines:
        kind = event.get("type") if isinstance(event, dict) else None
        part = event.get("part") if isinstance(event, dict) else None
        if isinstance(event, dict):
            reading.session_id = event.get("sessionID") or reading.session_id
        if kind == "text" and isinstance(part, dict):
            more = {
                "event": remaining_fields(event, "part"),
                "part": remaining_fields(part, "text"),
            }
            reading.steps.append(
                ParsedStep(source="agent", message=str(part.get("text", "")), extra=more)
            )
        elif kind == "tool_use" and isinstance(part, dict):
            reading.steps.append(_opencode_call(event, part))
        elif kind == "step_finish" and isinstance(part, dict):
            _opencode_usage(reading, part)
            reading.keep_unknown(event)
        else:
            reading.keep_unknown(event)
    return reading


def _opencode_call(event: dict[str, Any], part: dict[str, Any]) -> ParsedStep:
    state = part.get("state")
    state = state if isinstance(state, dict) else {}
    call = AtifToolCall(
        tool_call_id=str(part.get("callID") or part.get("id")),
        function_name=str(part.get("tool")),
        arguments=parse_arguments(state.get("input")),
    )
    failed = state.get("status") == "error"
    result = AtifResult(
        source_call_id=call.tool_call_id,
        content=parse_content(state.get("error") if failed else state.get("output")),
        extra={"is_error": failed},
    )
    more = {
        "event": remaining_fields(event, "part"),
        "part": remaining_fields(part, "state", "callID", "tool"),
        "state": remaining_fields(state, "input", "output", "error"),
    }
    return ParsedStep(source="agent", calls=[call], results=[result], extra=more)


def _opencode_usage(reading: ParsedTranscript, part: dict[str, Any]) -> None:
    tokens, acting = part.get("tokens"), [s for s in reading.steps if s.source == "agent"]
    if not isinstance(tokens, dict) or not acting:
        return
    cache = tokens.get("cache")
    cached = int(cache.get("read") or 0) if isinstance(cache, dict) else 0
    cost = part.get("cost")
    acting[-1].metrics = AtifMetrics(
        prompt_tokens=int(tokens.get("input") or 0) + cached,
        cached_tokens=cached,
        completion_tokens=int(tokens.get("output") or 0) + int(tokens.get("reasoning") or 0),
        cost_usd=float(cost) if isinstance(cost, int | float) else None,
    )
