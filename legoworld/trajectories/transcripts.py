"""Transcripts of agents as one format, ATIF: nothing that a transcript says is lost but pictures.

The parts of a trial that was continued are one trajectory. What ATIF has no field for goes into
`extra`. A line that is not JSON (a killed agent's last one, a notice on standard output) is a step
of its own with the line as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec.structs import replace

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
from legoworld.trajectories.event_lines import codex_steps, gemini_steps, opencode_steps
from legoworld.trajectories.steps import ParsedStep, ParsedTranscript, without_pictures

_LINES: Final[Mapping[str, Callable[[list[Any]], ParsedTranscript]]] = {
    "codex": codex_steps,
    "claude": claude_steps,
    "gemini": gemini_steps,
    "opencode": opencode_steps,
}


def read_transcript(
    path: Path | None,
    kind: TranscriptFormat,
    *,
    agent: str,
    version: str,
    prompt: str,
    scene_folder: Path | None = None,
) -> AtifTrajectory:
    """A transcript as ATIF; one that is not there has the prompt as its only step.

    agent, version, prompt: what the runtime knows, where the transcript does not say; scene_folder:
    where the pictures become files, None to leave them out.
    """
    data = path.read_bytes() if path is not None and path.is_file() else b""
    if kind == "atif":
        try:
            return _number_steps(_read_atif(data, scene_folder))
        except RecordError as error:
            return _document(
                agent, version, prompt, ParsedTranscript(notes=f"no transcript: {error}")
            )
    reading = _LINES[kind](parsed_lines(data, scene_folder))
    return _document(agent, version, prompt, reading)


def parsed_lines(data: bytes, scene_folder: Path | None = None) -> list[Any]:
    """The JSON value of each line; the line as text where it is none."""
    values: list[Any] = []
    for line in data.split(b"\n"):
        if line.strip():
            try:
                values.append(without_pictures(msgspec.json.decode(line), scene_folder))
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                values.append(line.decode("utf-8", "replace"))
    return values


def total_usage(trajectory: AtifTrajectory) -> Usage:
    """Tokens and cost of a trajectory: its own totals, or the sum over its steps."""
    total = trajectory.final_metrics or None
    steps = [step.metrics for step in trajectory.steps if step.metrics]

    def total_or_sum(whole: str, each: str) -> Any:
        given = _none_if_unset(getattr(total, whole, None))
        if given is not None:
            return given
        values = [value for m in steps if (value := _none_if_unset(getattr(m, each))) is not None]
        return sum(values) if values else None

    prompt = total_or_sum("total_prompt_tokens", "prompt_tokens")
    completion = total_or_sum("total_completion_tokens", "completion_tokens")
    return Usage(
        prompt_tokens=prompt,
        completion_tokens=completion,
        cached_tokens=total_or_sum("total_cached_tokens", "cached_tokens"),
        cost_usd=total_or_sum("total_cost_usd", "cost_usd"),
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


def _read_atif(data: bytes, scene_folder: Path | None) -> AtifTrajectory:
    """A document in ATIF. RecordError for another."""
    document = decode(dict[str, Any], data)
    lifted = without_pictures(document, scene_folder)
    return decode(AtifTrajectory, data if lifted == document else msgspec.json.encode(lifted))


def _number_steps(trajectory: AtifTrajectory) -> AtifTrajectory:
    steps: list[AtifStep] = [
        replace(step, step_id=number) for number, step in enumerate(trajectory.steps, start=1)
    ]
    return replace(trajectory, steps=steps)


def join_trajectories(parts: Sequence[AtifTrajectory]) -> AtifTrajectory:
    """Concatenate the parts' steps; each later part follows a step that announces it.

    Totals are present only if every part reports them: a killed part may not, and its tokens are
    not estimated.
    """
    if len(parts) == 1:
        return parts[0]
    steps: list[AtifStep] = []
    for number, part in enumerate(parts, start=1):
        if number > 1:
            said = f"The run was killed; here its part {number} begins."
            steps.append(AtifStep(step_id=0, source="system", message=said))
        steps += part.steps
    steps = [replace(step, step_id=number) for number, step in enumerate(steps, start=1)]
    used = [total_usage(part) for part in parts]

    def total(name: str) -> Any:
        values = [getattr(usage, name) for usage in used]
        return UNSET if None in values else sum(values)

    metrics = AtifFinalMetrics(
        total_prompt_tokens=total("prompt_tokens"),
        total_cached_tokens=total("cached_tokens"),
        total_completion_tokens=total("completion_tokens"),
        total_cost_usd=total("cost_usd"),
        total_steps=len(steps),
    )
    return replace(parts[-1], steps=steps, final_metrics=metrics)
