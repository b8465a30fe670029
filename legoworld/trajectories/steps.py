"""Steps while a transcript is read: calls first, what they came back with later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from legoworld.files import Json
from legoworld.records.atif import (
    AtifFinalMetrics,
    AtifMetrics,
    AtifObservation,
    AtifResult,
    AtifStep,
    AtifToolCall,
    Content,
)
from legoworld.records.base import UNSET
from legoworld.trajectories.pictures import is_picture_file


@dataclass(kw_only=True)
class ParsedStep:
    """One step as far as it was read. extra: what ATIF has no field for."""

    source: Literal["system", "user", "agent"]
    message: Content = ""
    reasoning: str = ""
    calls: list[AtifToolCall] = field(default_factory=list)
    results: list[AtifResult] = field(default_factory=list)
    metrics: AtifMetrics | None = None
    model: str | None = None
    timestamp: str | None = None
    extra: dict[str, Any] = field(default_factory=dict)

    def atif(self, number: int) -> AtifStep:
        """The step with its number."""
        acting = self.source == "agent"
        return AtifStep(
            step_id=number,
            source=self.source,
            message=self.message,
            timestamp=self.timestamp or UNSET,
            model_name=(self.model or UNSET) if acting else UNSET,
            reasoning_content=(self.reasoning or UNSET) if acting else UNSET,
            tool_calls=(self.calls or UNSET) if acting else UNSET,
            observation=AtifObservation(results=self.results) if self.results else UNSET,
            metrics=(self.metrics or UNSET) if acting else UNSET,
            extra=self.extra or UNSET,
        )


@dataclass(kw_only=True)
class ParsedTranscript:
    """A transcript as far as it was read."""

    steps: list[ParsedStep] = field(default_factory=list)
    session_id: str | None = None
    model: str | None = None
    notes: str | None = None
    total: AtifFinalMetrics | None = None

    def keep_unknown(self, event: Json) -> None:
        """Keep an event without a matching field, or a line that is not an event."""
        if isinstance(event, dict):
            kind = str(event.get("type", "event"))
            self.steps.append(ParsedStep(source="system", message=kind, extra={"event": event}))
        else:
            self.steps.append(ParsedStep(source="system", message=str(event)))


def parse_arguments(value: Json) -> dict[str, Any]:
    """A call's arguments as an object; any other value is stored under one key."""
    if isinstance(value, dict):
        return value
    return {} if value is None else {"value": value}


def remaining_fields(event: Mapping[str, Json], *lifted: str) -> dict[str, Any]:
    """An event without the named keys."""
    return {key: value for key, value in event.items() if key not in lifted}


def parse_content(value: Json) -> Content | None:
    """Text, or a list of parts, as ATIF has it. Pictures are files, which parts name.

    A part of MCP or of a model's API is turned into ATIF's: {"type": "text", "text": ...}.
    """
    if value is None or isinstance(value, str):
        return value
    if not isinstance(value, list):
        return [{"type": "text", "text": _as_text(value)}]
    parts = [part if isinstance(part, dict) else {"type": "text", "text": part} for part in value]
    if all(part.get("type") == "text" and set(part) <= {"type", "text"} for part in parts):
        return "\n".join(str(part["text"]) for part in parts)
    return [
        part
        if is_picture_file(part)
        else {"type": "text", "text": str(part["text"])}
        if part.get("type") == "text"
        else {"type": "text", "text": _as_text(part)}
        for part in parts
    ]


def _as_text(value: Json) -> str:
    import json

    return json.dumps(value, ensure_ascii=False, sort_keys=True)
