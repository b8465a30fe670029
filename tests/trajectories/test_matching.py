"""Steps of a transcript and the calls that Blender answered."""

from __future__ import annotations

import pytest

from legoworld.records.atif import AtifAgent, AtifStep, AtifToolCall, AtifTrajectory
from legoworld.records.endpoint import Call
from legoworld.trajectories.call_steps import add_calls

#: What the server runs for `look`.
OWN = "import json; render()"


def numbers(steps, calls):
    """The call numbers of each step. steps: of tools with their code; calls: command, code, by."""
    made = [
        AtifStep(
            step_id=number, source="agent",
            tool_calls=[
                AtifToolCall(tool_call_id=f"{number}{i}", function_name=name,
                             arguments={} if code is None else {"code": code})
                for i, (name, code) in enumerate(tools)
            ],
        )
        for number, tools in enumerate(steps, start=1)
    ]  # fmt: skip
    document = AtifTrajectory(
        schema_version="ATIF-v1.6", session_id="s", agent=AtifAgent(name="a", version="1"),
        steps=made,
    )  # fmt: skip
    answered = [
        Call(number=n, command=command, code=code, at_s=float(n), seconds=0.5, status="success",
             said="", checkpoint=None, by=by)
        for n, (command, code, by) in enumerate(calls, start=1)
    ]  # fmt: skip
    found = add_calls(document, answered).steps
    return [(step.extra or {}).get("legoworld", {}).get("calls", []) for step in found]


def code(text, by="agent"):
    return ("execute_code", text, by)


BUILD, PAINT = ("mcp__blender__execute_blender_code", "a"), ("execute_blender_code", "b")
LOOK, ABOUT, OTHER = ("mcp__blender__look", None), ("get_scene_info", None), ("Read", None)
PICTURE = ("get_viewport_screenshot", None, "agent")


@pytest.mark.parametrize(
    ("steps", "calls", "expected"),
    [
        ([[BUILD], [LOOK], [PAINT]], [code("a"), code(OWN), code("b")], [[1], [2], [3]]),
        ([[BUILD], [LOOK], [ABOUT]], [code("a"), PICTURE, code(OWN)], [[1], [2], [3]]),
        ([[BUILD], [OTHER], [LOOK]], [code("a"), code(OWN), PICTURE], [[1], [], [2, 3]]),
        ([[BUILD, LOOK], [PAINT]], [code("a"), PICTURE, code("b")], [[1, 2], [3]]),
        # Two looks and three calls: whose is whose is not known.
        ([[LOOK], [ABOUT], [BUILD]], [PICTURE, code(OWN), PICTURE, code("a")], [[], [], [4]]),
        # The server's own questions, and the plugin's, are nobody's.
        ([[LOOK], [BUILD]], [("get_addon_info", None, "agent"), PICTURE, code("a")], [[2], [3]]),
        ([[LOOK], [BUILD]], [code("m", "plugin"), PICTURE, code("a")], [[2], [3]]),
        ([[BUILD], [BUILD]], [code("a"), code(OWN), code("a")], [[1], [3]]),
        ([[("run", "never sent")], [LOOK]], [PICTURE], [[], [1]]),
    ],
)
def test_code_is_matched_by_its_text_and_looks_by_their_place(steps, calls, expected):
    assert numbers(steps, calls) == expected
