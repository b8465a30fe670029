"""Transcripts of agents as one format, ATIF: nothing that a transcript says is lost but pictures.

What ATIF has no field for goes into `extra`. A line that is not JSON (a killed agent's last one, a
notice on standard output) is a step of its own with the line as it is.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec.structs import replace

from legoworld.files import Json
from legoworld.records.agents import TranscriptFormat, Usage
from legoworld.records.atif import (
    ATIF_VERSION,
    AtifAgent,
    AtifFinalMetrics,
    AtifStep,
    AtifTrajectory,
)
from legoworld.records.base import UNSET, RecordError, UnsetType, decode
from legoworld.trajectories.claude_lines import claude_steps
from legoworld.trajectories.codex_lines import codex_steps
from legoworld.trajectories.event_lines import gemini_steps, opencode_steps
from legoworld.trajectories.steps import ParsedStep, ParsedTranscript

_LINES: Final[Mapping[str, Callable[[list[Any]], ParsedTranscript]]] = {
    "codex": codex_steps,
    "claude": claude_steps,
    "gemini": gemini_steps,
    "opencode": opencode_steps,
}
#: How base64 begins of what agents look at.
_PICTURES: Final = {
    "iVBORw0KGgo": "image/png",
    "/9j/": "image/jpeg",
    "UklGR": "image/webp",
    "R0lGOD": "image/gif",
}
_SHORTEST_PICTURE: Final = 64
_DATA_URL: Final = re.compile(r"^data:image/[\w.+-]+;base64,")
_BASE64: Final = re.compile(r"[A-Za-z0-9+/]+={0,2}")


def read_transcript(
    path: Path | None, kind: TranscriptFormat, *, agent: str, version: str, prompt: str
) -> AtifTrajectory:
    """A transcript as ATIF; one that is not there has the prompt as its only step.

    agent, version, prompt: what the runtime knows, where the transcript does not say.
    """
    data = path.read_bytes() if path is not None and path.is_file() else b""
    if kind == "atif":
        try:
            return _number_steps(decode(AtifTrajectory, data))
        except RecordError as error:
            return _document(
                agent, version, prompt, ParsedTranscript(notes=f"no transcript: {error}")
            )
    reading = _LINES[kind](parsed_lines(data))
    return _document(agent, version, prompt, reading)


def without_pictures(value: Json) -> Json:
    """A JSON value with every picture in base64, in text or as a data URL, as its size and hash.

    The transcript itself keeps the bytes.
    """
    if isinstance(value, dict):
        return {key: without_pictures(item) for key, item in value.items()}
    if isinstance(value, list):
        return [without_pictures(item) for item in value]
    if not isinstance(value, str) or len(value) < _SHORTEST_PICTURE:
        return value
    text = _DATA_URL.sub("", value)
    kind = next((kind for begin, kind in _PICTURES.items() if text.startswith(begin)), None)
    if kind is None or not _BASE64.fullmatch(text) or len(text) % 4:
        return value
    data = base64.b64decode(text)
    return f"[{kind}, {len(data)} bytes, sha256 {hashlib.sha256(data).hexdigest()}]"


def parsed_lines(data: bytes) -> list[Any]:
    """The JSON value of each line; the line as text where it is none."""
    values: list[Any] = []
    for line in data.split(b"\n"):
        if line.strip():
            try:
                values.append(without_pictures(msgspec.json.decode(line)))
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                values.append(line.decode("utf-8", "replace"))
    return values


def total_usage(trajectory: AtifTrajectory) -> Usage:
    """Tokens and cost of a trajectory: its own totals, or the sum over its steps."""
    total = trajectory.final_metrics or None
    steps = [step.metrics for step in trajectory.steps if step.metrics]

    def summed(whole: str, each: str) -> Any:
        given = _none_if_unset(getattr(total, whole, None))
        if given is not None:
            return given
        values = [value for m in steps if (value := _none_if_unset(getattr(m, each))) is not None]
        return sum(values) if values else None

    prompt = summed("total_prompt_tokens", "prompt_tokens")
    completion = summed("total_completion_tokens", "completion_tokens")
    return Usage(
        prompt_tokens=prompt,
        completion_tokens=completion,
        cached_tokens=summed("total_cached_tokens", "cached_tokens"),
        cost_usd=summed("total_cost_usd", "cost_usd"),
        tokens_source=None if (prompt, completion) == (None, None) else "transcript",
    )


def _none_if_unset(value: Any) -> Any:
    return None if isinstance(value, UnsetType) else value


def _document(agent: str, version: str, prompt: str, reading: ParsedTranscript) -> AtifTrajectory:
    steps = [ParsedStep(source="user", message=prompt), *reading.steps]
    total = reading.total
    return AtifTrajectory(
        schema_version=ATIF_VERSION,
        session_id=reading.session_id or agent,
        agent=AtifAgent(name=agent, version=version, model_name=reading.model or UNSET),
        steps=[step.atif(number) for number, step in enumerate(steps, start=1)],
        notes=reading.notes or UNSET,
        final_metrics=replace(total or AtifFinalMetrics(), total_steps=len(steps)),
    )


def _number_steps(trajectory: AtifTrajectory) -> AtifTrajectory:
    steps: list[AtifStep] = [
        replace(step, step_id=number) for number, step in enumerate(trajectory.steps, start=1)
    ]
    return replace(trajectory, steps=steps)
