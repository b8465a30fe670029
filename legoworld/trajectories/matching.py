"""Which step of a transcript made which call to Blender: by the code, in order."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from legoworld.records.atif import AtifStep, AtifTrajectory
from legoworld.records.endpoint import Call

_CODE = "code"


def with_calls(trajectory: AtifTrajectory, calls: Sequence[Call]) -> AtifTrajectory:
    """The trajectory with `extra.legoworld` at each step that made calls: their numbers and times.

    A step's call of code is the first call of the same code that no step before has. Calls that the
    MCP server made on its own (a scene's summary is code, too) belong to no step.
    """
    waiting = [call for call in calls if call.code is not None and call.by == "agent"]
    steps = []
    for step in trajectory.steps:
        made: list[Call] = []
        for code in _codes(step):
            call_made = next((call for call in waiting if call.code == code), None)
            if call_made is not None:
                made.append(call_made)
                del waiting[: waiting.index(call_made) + 1]
        steps.append(_with(step, made) if made else step)
    return replace(trajectory, steps=steps)


def _codes(step: AtifStep) -> list[str]:
    calls = step.tool_calls
    if not isinstance(calls, list):
        return []
    return [code for call in calls if isinstance(code := call.arguments.get(_CODE), str)]


def _with(step: AtifStep, made: list[Call]) -> AtifStep:
    extra = dict(step.extra) if isinstance(step.extra, dict) else {}
    extra["legoworld"] = {
        "calls": [call.number for call in made],
        "begun_s": made[0].at_s,
        "ended_s": round(made[-1].at_s + made[-1].seconds, 4),
    }
    return replace(step, extra=extra)
