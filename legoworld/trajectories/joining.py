"""The parts of a trial that was continued, as one trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from msgspec.structs import replace

from legoworld.records.atif import AtifFinalMetrics, AtifStep, AtifTrajectory
from legoworld.records.base import UNSET
from legoworld.trajectories.transcripts import usage_of


def joined(parts: Sequence[AtifTrajectory]) -> AtifTrajectory:
    """One document: the parts' steps in order, each later part after a step that says so.

    A total is there where every part tells it: a killed part may have told none, and its tokens are
    not guessed.
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
    used = [usage_of(part) for part in parts]

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
