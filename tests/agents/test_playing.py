"""What `program` makes of the answers to its steps; the servers are stood in for."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
from contextlib import asynccontextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from legoworld.agents.blender_mcp import play

MUST = {"tool": "t", "arguments": {}, "must_succeed": True}


def part(text: str | None = None) -> SimpleNamespace:
    return SimpleNamespace(type="image" if text is None else "text", text=text)


def answer(*parts: SimpleNamespace, failed: bool = False) -> SimpleNamespace:
    return SimpleNamespace(content=parts, isError=failed)


def play_steps(monkeypatch, folder, answers, steps) -> tuple[int, dict[str, Any]]:
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
    code, document = play_steps(monkeypatch, tmp_path, answers, [MUST] * 3)
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
    code, document = play_steps(monkeypatch, tmp_path, answers, steps)
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


def test_a_step_is_written_with_its_words_its_call_and_its_answer(monkeypatch, tmp_path):
    steps = [
        {"tool": "t", "arguments": {"a": 1}, "message": "I look."},
        {"tool": "t", "arguments": {}, "server": "blender"},
    ]
    answers = [answer(part("seen"), part()), answer(part("done"))]
    code, document = play_steps(monkeypatch, tmp_path, answers, steps)
    assert (code, document["schema_version"]) == (0, "ATIF-v1.6")
    assert (document["session_id"], document["agent"]["name"]) == ("program", "program")
    prompt, *rows = document["steps"]
    assert all(row.pop("timestamp") for row in (prompt, *rows))
    assert prompt == {"step_id": 1, "source": "user", "message": "Build it."}
    assert rows == [
        {
            "step_id": number + 1, "source": "agent", "message": said, "llm_call_count": 0,
            "tool_calls": [
                {"tool_call_id": f"call_{number}", "function_name": "t", "arguments": arguments}
            ],
            "observation": {"results": [
                {"source_call_id": f"call_{number}", "content": content,
                 "extra": {"is_error": False, "images": images}}
            ]},
        }
        for number, said, arguments, content, images in [
            (1, "I look.", {"a": 1}, "seen", 1), (2, "", {}, "done", 0),
        ]
    ]  # fmt: skip
    assert [path.name for path in tmp_path.iterdir()] == ["transcript.json"]


def test_the_relay_carries_both_ways_until_the_server_ends():
    """As an agent starts it: a program of its own, with nothing of legoworld."""
    relay = Path(play.__file__).with_name("relay.py")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = str(listener.getsockname()[1])
        command = [sys.executable, str(relay), "127.0.0.1", port]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as run:
            listener.settimeout(60)
            line, _ = listener.accept()
            with line:
                line.settimeout(60)
                run.stdin.write(b"question" * 20_000)
                run.stdin.close()
                heard = b"".join(iter(lambda: line.recv(1 << 16), b""))
                line.sendall(b"answer" * 20_000)
            assert run.stdout.read() == b"answer" * 20_000
            assert run.wait(60) == 0
    assert heard == b"question" * 20_000
