"""A Blender process that is started while the command imports what it needs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from legoworld import cli
from legoworld.errors import SceneInvalidError
from legoworld.scene.blender_process import BlenderProcess

pytestmark = pytest.mark.own_blender


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    made: list[str] = []
    monkeypatch.setattr(BlenderProcess, "start", lambda _self: made.append("start"))
    monkeypatch.setattr(BlenderProcess, "close", lambda _self: made.append("close"))
    return made


def readout(folder: Path, *more: str) -> int:
    """The exit code of a readout whose only scene is missing: no reader starts a process."""
    track = folder / "track.json"
    image = {"id": 1, "file_name": "a.jpg", "width": 8, "height": 8}
    track.write_text(json.dumps({"images": [image], "categories": [{"id": 1, "name": "cup"}]}))
    (folder / "scenes").mkdir(exist_ok=True)
    output = ["--track", str(track), "-o", str(folder / "run"), "-q"]
    return cli.run(["readout", str(folder / "scenes"), "--task", "coco", *output, *more])


def test_without_a_cache_blender_starts_ahead_and_ends_with_the_command(calls, tmp_path, capsys):
    assert readout(tmp_path, "--no-cache") == 1
    assert calls[0] == "start"
    assert calls[-1] == "close"
    assert calls.count("start") == 1


def test_the_process_that_was_started_reads_the_scenes(calls, tmp_path, monkeypatch, capsys):
    used: list[tuple[str, int]] = []

    def request(self: BlenderProcess, _message: object) -> None:
        used.append(("request", id(self)))
        raise SceneInvalidError("it was asked")

    monkeypatch.setattr(BlenderProcess, "start", lambda self: used.append(("start", id(self))))
    monkeypatch.setattr(BlenderProcess, "request", request)
    (tmp_path / "scenes" / "a").mkdir(parents=True)
    (tmp_path / "scenes" / "a" / "scene.blend").write_text("a scene")
    assert readout(tmp_path, "--no-cache") == 1
    assert [what for what, _ in used] == ["start", "request"]
    assert len({number for _, number in used}) == 1
    assert calls.count("close") == 1  # by the command, not by the reader


@pytest.mark.parametrize("more", [(), ("--no-cache", "--source", "glb")])
def test_what_may_need_no_blender_starts_none(more, calls, tmp_path, capsys):
    cached = () if more else ("--cache", str(tmp_path / "cache"))
    assert readout(tmp_path, *more, *cached) == 1
    assert "start" not in calls


def test_a_refused_command_leaves_no_process(calls, tmp_path, capsys):
    assert readout(tmp_path, "--no-cache", "--image-id", "7") == 2
    assert calls == ["start", "close"]


def test_the_program_ends_with_its_code_and_all_its_output(tmp_path):
    """It leaves without taking the interpreter apart: what others left to be done is done."""
    program = (
        "import atexit, sys; from legoworld import cli; atexit.register(print, 'done at exit');"
        "sys.argv = ['legoworld', 'list', *sys.argv[1:]]; cli.entry()"
    )
    for word, code in (("tasks", 0), ("nonsense", 2)):
        done = subprocess.run(
            [sys.executable, "-c", program, word], capture_output=True, text=True, check=False
        )
        assert done.returncode == code
        assert done.stdout.splitlines()[-1] == "done at exit"
    assert "coco" in subprocess.run(
        [sys.executable, "-m", "legoworld", "list", "tasks"], capture_output=True, text=True,
        check=True,
    ).stdout  # fmt: skip
