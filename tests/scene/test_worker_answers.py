"""What a command gets of an error in the worker: its verdict, or the disk that is full."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from legoworld.errors import LegoWorldError, NoCameraError, WorkerMemoryError
from legoworld.scene.blender import worker
from legoworld.scene.blender_process import BlenderProcess, Limits

OUTPUT = "/results/run/.writing-1/snapshot.npz"


@pytest.fixture
def asked(monkeypatch):
    """What a request of a scene ends with whose handler does this."""

    def ask(error: Exception) -> Any:
        def handler(_request: object) -> dict[str, Any]:
            raise error

        blender = BlenderProcess(Limits(memory_bytes=3 << 30))
        answers: list[bytes] = []
        process = SimpleNamespace(
            send=lambda line: answers.append(json.dumps(worker._answer(json.loads(line))).encode())
        )
        monkeypatch.setitem(worker._REQUESTS, "snapshot", handler)
        monkeypatch.setattr(blender, "_start_worker", lambda: process)
        monkeypatch.setattr(blender, "_answer_line", lambda *_: answers.pop())
        with pytest.raises((LegoWorldError, OSError)) as raised:
            blender._ask({"kind": "snapshot", "blend": "scene.blend", "output": OUTPUT})
        return raised.value

    return ask


@pytest.mark.parametrize("name", ["ENOSPC", "EDQUOT", "EROFS", "EFBIG"])
def test_a_full_or_read_only_disk_is_no_verdict_on_the_scene(asked, name):
    error = asked(OSError(getattr(errno, name), "said by Blender", "/tmp/other"))
    assert isinstance(error, OSError)
    assert error.errno == getattr(errno, name)
    assert error.strerror == os.strerror(error.errno)
    assert error.filename == str(Path(OUTPUT).parents[1])


def test_any_other_error_is_a_bug_with_its_place(asked):
    for raised in (OSError(errno.EIO, "no"), ValueError("no")):
        error = asked(raised)
        assert isinstance(error, LegoWorldError)
        assert error.what == "unexpected error while reading the scene"
        assert f"{type(raised).__name__}: {raised} (test_worker_answers.py, line" in error.found
        assert "Traceback" in error.trace


def test_memory_that_runs_out_is_told_with_the_limit(asked):
    error = asked(MemoryError())
    assert isinstance(error, WorkerMemoryError)
    assert error.found == "more than 3 GiB"


def test_a_verdict_is_handed_on_as_it_is(asked):
    given = NoCameraError("no camera", found="a", expected="b", next_step="c")
    error = asked(given)
    assert type(error) is NoCameraError
    assert error.reason() == given.reason()
    assert error.trace == ""
