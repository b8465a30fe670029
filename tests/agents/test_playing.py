"""What `program` makes of the answers to its steps; the servers are stood in for."""

from __future__ import annotations

import asyncio
import json
import sys
from contextlib import asynccontextmanager
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from legoworld.agents.blender_mcp import play

MUST = {"tool": "t", "arguments": {}, "must_succeed": True}


def part(text: str | None = None) -> SimpleNamespace:
    return SimpleNamespace(type="image" if text is None else "text", text=text)


def answer(*parts: SimpleNamespace, failed: bool = False) -> SimpleNamespace:
    return SimpleNamespace(content=parts, isError=failed)


def played(monkeypatch, folder, answers, steps) -> tuple[int, dict[str, Any]]:
    """The exit code and the transcript of steps that get these answers."""
    left = iter(answers)

    class Session:
        async def list_tools(self):
            return SimpleNamespace(tools=[SimpleNamespace(name="t")])

        async def call_tool(self, *_given):
            return next(left)

    @asynccontextmanager
    async def session(_server):
        yield Session()

    monkeypatch.setattr(play, "_session", session)
    transcript = play.Transcript(folder / "transcript.json", "Build it.")
    code = asyncio.run(play._play({"blender": {}}, steps, transcript))
    return code, json.loads((folder / "transcript.json").read_text())


@pytest.mark.parametrize(
    "failing",
    [answer(part("Error executing code: no such chair")), answer(part("no"), failed=True)],
    ids=["code that raised", "a protocol error"],
)
def test_nothing_is_played_after_a_step_that_had_to_succeed(monkeypatch, tmp_path, failing):
    answers = [answer(part("a"), part(), part("b")), failing, answer(part("late"))]
    code, document = played(monkeypatch, tmp_path, answers, [MUST] * 3)
    assert code == 1
    prompt, *steps = document["steps"]
    assert prompt["message"] == "Build it."
    results = [step["observation"]["results"][0] for step in steps]
    assert [result["extra"] for result in results] == [
        {"is_error": False, "images": 1},
        {"is_error": True, "images": 0},
    ]
    assert results[0]["content"] == "a\nb"
    assert document["final_metrics"] == {"total_steps": 3}
    assert document["agent"]["tool_definitions"][0]["function"] == {"name": "t"}


def test_another_step_s_failure_is_played_on_from(monkeypatch, tmp_path):
    answers = [answer(part("no"), failed=True), answer(part("yes"))]
    steps = [{**MUST, "must_succeed": False}, MUST]
    code, document = played(monkeypatch, tmp_path, answers, steps)
    assert code == 0
    assert len(document["steps"]) == 3


def test_what_a_server_logs_is_not_the_player_s(monkeypatch, capfd):
    """Its own output is what a failed trial's reason is read off."""

    @asynccontextmanager
    async def stdio_client(_how, errlog=None):
        print("a server's log", file=errlog or sys.stderr)
        yield None, None

    @asynccontextmanager
    async def client_session(_read, _write):
        async def initialize():
            pass

        yield SimpleNamespace(initialize=initialize)

    started: list[dict[str, Any]] = []
    mcp, stdio = ModuleType("mcp"), ModuleType("mcp.client.stdio")
    vars(mcp).update(
        StdioServerParameters=lambda **how: started.append(how), ClientSession=client_session
    )
    vars(stdio).update(stdio_client=stdio_client)
    monkeypatch.setitem(sys.modules, "mcp", mcp)
    monkeypatch.setitem(sys.modules, "mcp.client.stdio", stdio)

    async def begun():
        for more in ({}, {"args": ["a"], "env": {"V": "1"}}):
            async with play._session({"command": "server", **more}):
                pass

    asyncio.run(begun())
    assert started == [
        {"command": "server", "args": [], "env": None},
        {"command": "server", "args": ["a"], "env": {"V": "1"}},
    ]
    assert capfd.readouterr().err == ""
