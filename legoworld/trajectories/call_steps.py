"""Which step of a transcript made which call to Blender: by the code, in order."""

from __future__ import annotations

import itertools
from collections.abc import MutableMapping, Sequence
from typing import Final

from msgspec.structs import replace

from legoworld.records.atif import AtifStep, AtifTrajectory
from legoworld.records.endpoint import Call

_CODE = "code"
#: The tools of an MCP server through which an agent looks at a scene; programs put a prefix before.
_LOOKS: Final = ("look", "get_scene_info", "get_object_info", "get_viewport_screenshot",
                 "list_scene_items")  # fmt: skip


def add_calls(trajectory: AtifTrajectory, calls: Sequence[Call]) -> AtifTrajectory:
    """The trajectory with `extra.legoworld` at each step that made calls: their numbers and times.

    A step's call of code is the first call of the same code that no step before has. For a look the
    MCP server sends code of its own, or asks for a picture: the calls between two of an agent's are
    the looks' between them, where there are as many of both, or one look. All others belong to no
    step.
    """
    waiting = [call for call in calls if call.by == "agent"]
    made: MutableMapping[int, list[Call]] = {}
    looks: list[int] = []
    at = 0
    for number, code in _list_code_calls(trajectory):
        if code is None:
            looks.append(number)
            continue
        place = next((i for i in range(at, len(waiting)) if waiting[i].code == code), None)
        if place is None:
            continue
        _share_looks(looks, waiting[at:place], made)
        made.setdefault(number, []).append(waiting[place])
        looks, at = [], place + 1
    _share_looks(looks, waiting[at:], made)
    steps = [
        _add_calls(step, sorted(made[number], key=lambda call: call.number))
        if number in made
        else step
        for number, step in enumerate(trajectory.steps)
    ]
    return replace(trajectory, steps=steps)


def _list_code_calls(trajectory: AtifTrajectory) -> list[tuple[int, str | None]]:
    """The steps' calls of code, and their looks as None, in order, each with its step's place."""
    calls: list[tuple[int, str | None]] = []
    for number, step in enumerate(trajectory.steps):
        for call in step.tool_calls if isinstance(step.tool_calls, list) else []:
            code = call.arguments.get(_CODE)
            if isinstance(code, str):
                calls.append((number, code))
            elif call.function_name.endswith(_LOOKS):
                calls.append((number, None))
    return calls


def _share_looks(
    looks: Sequence[int], calls: Sequence[Call], made: MutableMapping[int, list[Call]]
) -> None:
    """Give the calls between two of an agent's to the looks between them."""
    calls = [call for call in calls if call.command in ("execute_code", *_LOOKS)]
    if len(looks) == 1:
        looks = list(itertools.repeat(looks[0], len(calls)))
    if len(looks) == len(calls):
        for number, call in zip(looks, calls, strict=True):
            made.setdefault(number, []).append(call)


def _add_calls(step: AtifStep, calls: list[Call]) -> AtifStep:
    extra = dict(step.extra) if isinstance(step.extra, dict) else {}
    extra["legoworld"] = {
        "calls": [call.number for call in calls],
        "begun_s": calls[0].at_s,
        "ended_s": round(calls[-1].at_s + calls[-1].seconds, 4),
    }
    return replace(step, extra=extra)
