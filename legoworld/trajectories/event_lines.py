"""The events of Gemini CLI (--output-format stream-json) and of OpenCode (--format json).

https://geminicli.com/docs/cli/headless/, https://opencode.ai/docs/cli/
"""

from __future__ import annotations

from typing import Any

from legoworld.records.atif import AtifFinalMetrics, AtifMetrics, AtifResult, AtifToolCall
from legoworld.trajectories.steps import (
    ParsedStep,
    ParsedTranscript,
    parse_arguments,
    parse_content,
    remaining_fields,
)


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
