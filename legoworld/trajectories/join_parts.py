"""The parts of a trial that was continued, as one trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from msgspec.structs import replace

from legoworld.records.atif import AtifFinalMetrics, AtifStep, AtifTrajectory
from legoworld.records.base import UNSET
from legoworld.trajectories.transcripts import total_usage


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
