"""The messages of `claude -p --output-format stream-json --verbose`, one a line.

https://code.claude.com/docs/en/headless; the files that Claude Code keeps of its sessions hold the
same messages with a time each.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from typing import Any

import msgspec

from legoworld.records.atif import AtifFinalMetrics, AtifMetrics, AtifResult, AtifToolCall
from legoworld.records.base import UNSET, UnsetType
from legoworld.trajectories.steps import (
    ParsedStep,
    ParsedTranscript,
    parse_arguments,
    parse_content,
    remaining_fields,
)


def claude_steps(lines: list[Any]) -> ParsedTranscript:
    """The steps of a Claude Code transcript.

    One message of the model may come in several lines, each with some of its blocks and all of its
    usage: they are one step, and its tokens count once.
    """
    reading = ParsedTranscript()
    of_message: dict[str, ParsedStep] = {}
    of_call: dict[str, ParsedStep] = {}
    for event in lines:
        kind = event.get("type") if isinstance(event, dict) else None
        message = event.get("message") if isinstance(event, dict) else None
        if kind == "assistant" and isinstance(message, dict):
            _model_said(reading, event, message, of_message, of_call)
        elif kind == "user" and isinstance(message, dict):
            _came_back(reading, event, message, of_call)
        elif kind == "result":
            _result(reading, event)
        else:
            if kind == "system":
                reading.session_id = event.get("session_id") or reading.session_id
                reading.model = event.get("model") or reading.model
            reading.keep_unknown(event)
    return reading


def _model_said(
    reading: ParsedTranscript,
    event: dict[str, Any],
    message: dict[str, Any],
    of_message: MutableMapping[str, ParsedStep],
    of_call: MutableMapping[str, ParsedStep],
) -> None:
    identity = str(message.get("id") or len(reading.steps))
    step = of_message.get(identity)
    if step is None:
        step = of_message[identity] = ParsedStep(source="agent")
        step.extra = {
            "message": remaining_fields(message, "content", "usage", "model"),
            "event": remaining_fields(event, "message", "type", "timestamp"),
        }
        reading.steps.append(step)
    step.model = message.get("model") or step.model
    step.timestamp = event.get("timestamp") or step.timestamp
    reading.model = reading.model or step.model
    if isinstance(message.get("usage"), dict):
        step.metrics = _metrics(message["usage"])
    content = message.get("content")
    for block in content if isinstance(content, list) else [{"type": "text", "text": content}]:
        _block(step, block, of_call)


def _block(step: ParsedStep, block: Any, of_call: MutableMapping[str, ParsedStep]) -> None:
    kind = block.get("type") if isinstance(block, dict) else None
    if kind == "text":
        step.message = "\n".join(filter(None, [str(step.message), str(block.get("text") or "")]))
    elif kind == "thinking":
        step.reasoning = "\n".join(filter(None, [step.reasoning, str(block.get("thinking"))]))
        if more := remaining_fields(block, "type", "thinking"):
            step.extra.setdefault("blocks", []).append(more)
    elif kind in ("tool_use", "server_tool_use") and isinstance(block.get("id"), str):
        call = AtifToolCall(
            tool_call_id=block["id"],
            function_name=str(block.get("name")),
            arguments=parse_arguments(block.get("input")),
        )
        step.calls.append(call)
        of_call[call.tool_call_id] = step
        if more := remaining_fields(block, "type", "id", "name", "input"):
            step.extra.setdefault("blocks", []).append(more)
    else:
        step.extra.setdefault("blocks", []).append(block)


def _came_back(
    reading: ParsedTranscript,
    event: dict[str, Any],
    message: dict[str, Any],
    of_call: Mapping[str, ParsedStep],
) -> None:
    content = message.get("content")
    if isinstance(content, str):
        reading.steps.append(ParsedStep(source="user", message=content, extra={"event": event}))
        return
    others = []
    for block in content if isinstance(content, list) else []:
        calling = of_call.get(str(block.get("tool_use_id"))) if isinstance(block, dict) else None
        if calling is None:
            others.append(block)
            continue
        more = remaining_fields(block, "type", "tool_use_id", "content", "is_error")
        about = remaining_fields(event, "message", "type", "session_id")
        calling.results.append(
            AtifResult(
                source_call_id=str(block["tool_use_id"]),
                content=parse_content(block.get("content")),
                extra={"is_error": bool(block.get("is_error")), **more, "event": about},
            )
        )
    if others or not isinstance(content, list):
        event = {**event, "message": {**message, "content": others}}
        reading.steps.append(ParsedStep(source="user", extra={"event": event}))


def _metrics(usage: Mapping[str, Any]) -> AtifMetrics:
    cached = int(usage.get("cache_read_input_tokens") or 0)
    fresh = int(usage.get("input_tokens") or 0)
    made = int(usage.get("cache_creation_input_tokens") or 0)
    return AtifMetrics(
        prompt_tokens=fresh + made + cached,
        cached_tokens=cached,
        completion_tokens=int(usage.get("output_tokens") or 0),
        extra={"usage": usage},
    )


def _result(reading: ParsedTranscript, event: dict[str, Any]) -> None:
    reading.session_id = event.get("session_id") or reading.session_id
    usage = event.get("usage")
    if isinstance(usage, dict):
        whole = _metrics(usage)
        cost = event.get("total_cost_usd")
        reading.total = AtifFinalMetrics(
            total_prompt_tokens=whole.prompt_tokens,
            total_cached_tokens=whole.cached_tokens,
            total_completion_tokens=whole.completion_tokens,
            total_cost_usd=float(cost) if isinstance(cost, int | float) else None,
        )
        _drop_placeholders(reading, whole.completion_tokens)
    reading.keep_unknown(event)


def _drop_placeholders(
    reading: ParsedTranscript, completion_tokens: int | UnsetType | None
) -> None:
    """Leave a step's output tokens out where they do not sum to the session's.

    Without partial messages a line has the usage that its message began with: an output of 1.
    """
    counted = [(step, step.metrics) for step in reading.steps if step.metrics is not None]
    if sum(int(found.completion_tokens or 0) for _, found in counted) != completion_tokens:
        for step, found in counted:
            step.metrics = msgspec.structs.replace(found, completion_tokens=UNSET)
