"""How an endpoint's Blender is started and read, with another program in its place."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest
from endpoint.clients import LIMITS

from legoworld.endpoint import blender
from legoworld.endpoint.blender import BlenderEndedError, LiveBlender
from legoworld.endpoint.session import Session
from legoworld.workers.protections import protections

#: Answers in pieces: first that it is there, then what it was asked and started with.
ANSWERS = """
import json, socket, struct, sys, time
line = socket.socket(socket.AF_UNIX)
line.connect(sys.argv[-2])
def say(result):
    data = json.dumps({"result": result, "seconds": 0.5}).encode()
    data = struct.pack(">I", len(data)) + data
    for at in range(0, len(data), 7):
        line.sendall(data[at : at + 7])
say("there")
size = struct.unpack(">I", line.recv(4, socket.MSG_WAITALL))[0]
asked = json.loads(line.recv(size, socket.MSG_WAITALL))
say([sys.argv[1:], asked["kind"], asked["params"]])
line.recv(1)
"""


def start_blender(folder, monkeypatch, text: str) -> LiveBlender:
    """Start a program with these words in the place of Blender's Python."""
    program = folder / "program"
    program.write_text(f"#!{sys.executable}\n{text}")
    program.chmod(0o755)
    monkeypatch.setattr(blender, "sys", SimpleNamespace(executable=str(program)))
    (folder / "workspace").mkdir()
    return LiveBlender(folder / "workspace", LIMITS, protections("limits"))


def test_an_answer_in_pieces_is_whole(tmp_path, monkeypatch):
    with start_blender(tmp_path, monkeypatch, ANSWERS) as live:
        reply = live.ask("look", {"text": "x" * 100}, 300.0)
    assert reply.result
    words, kind, params = reply.result
    assert words[:3] == ["-u", "-m", "legoworld.scene.blender.endpoint"]
    assert (kind, params) == ("look", {"text": "x" * 100})


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ("print('first\\nthen\\nwhy it ended\\n'); sys.exit(3)", "exit code 3.*why it ended"),
        ("print('why', flush=True); os.kill(os.getpid(), 11)", "SIGSEGV$"),
        ("os.kill(os.getpid(), 9)", "SIGKILL$"),
    ],
)
def test_why_it_ended_is_said(tmp_path, monkeypatch, ends, said):
    with pytest.raises(BlenderEndedError, match=said) as ended:
        start_blender(tmp_path, monkeypatch, f"import os, sys\n{ends}\n")
    assert ended.value.limit is None
    assert ended.value.killed == ("SIGKILL" in said)
    assert "first" not in str(ended.value)
    assert "then" not in str(ended.value)


@pytest.mark.parametrize(
    ("left_s", "last", "next_call"),
    [
        (5.0, None, "; the next call finds Blender started anew, with the scene as it began"),
        (5.0, 7, "; the next call finds Blender started anew, with the scene as call 7 left it"),
        (0.0, 7, "; no further call is possible"),
        (-1.0, None, "; no further call is possible"),
    ],
)
def test_what_the_next_call_finds_after_an_end_is_said(left_s, last, next_call):
    kept = {"live": None if last is None else SimpleNamespace(call=last)}
    session = SimpleNamespace(_left_s=lambda: left_s, _record=SimpleNamespace(last=kept.get))
    assert Session._describe_end(session, "Blender ended") == f"Blender ended{next_call}"
