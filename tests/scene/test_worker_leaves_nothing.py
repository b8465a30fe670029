"""However a Blender process ends, the folder for temporary files is as it was."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import threading
from pathlib import Path

import pytest

from legoworld.errors import LegoWorldError, WorkerCrashedError, WorkerTimeoutError
from legoworld.scene.blender_process import BlenderProcess, Limits

pytestmark = [pytest.mark.blender, pytest.mark.own_blender]


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that this process and its children take for their temporary files."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


def test_a_served_process_leaves_nothing(temporary: Path):
    with BlenderProcess(Limits(time_s=600)) as blender:
        assert blender.request({"kind": "version"})["blender"].startswith("5.")
        assert any(name.startswith("blender_") for name in names(temporary))
    assert names(temporary) == []


@pytest.mark.parametrize("kills", [1, 2])
def test_a_process_that_was_killed_is_replaced_once(temporary: Path, monkeypatch, kills):
    begun: list[int] = []
    start = BlenderProcess._start_worker

    def started(self):
        process = start(self)
        if len(begun) < kills and process.pid not in begun:
            begun.append(process.pid)
            os.kill(process.pid, signal.SIGKILL)
        return process

    monkeypatch.setattr(BlenderProcess, "_start_worker", started)
    with BlenderProcess(Limits(time_s=600)) as blender:
        if kills == 2:
            with pytest.raises(WorkerCrashedError, match="signal 9"):
                blender.request({"kind": "version"})
        else:
            assert "blender" in blender.request({"kind": "version"})
    assert len(begun) == kills
    assert names(temporary) == []


def test_a_process_that_ran_out_of_time_leaves_nothing(temporary: Path):
    with (
        BlenderProcess(Limits(time_s=0.01)) as blender,
        pytest.raises(WorkerTimeoutError, match=r"0\.01 s"),
    ):
        blender.request({"kind": "version"})
    assert names(temporary) == []


def test_an_aborted_process_leaves_nothing(temporary: Path):
    with BlenderProcess(Limits(time_s=600)) as blender:
        blender.request({"kind": "version"})
        blender.abort()
        with pytest.raises(LegoWorldError):
            blender.request({"kind": "version"})
    assert names(temporary) == []


def test_an_abort_while_the_process_is_started_ends_it(temporary: Path, monkeypatch):
    """It comes from another thread, when there is nothing yet that it could end."""
    made: list[subprocess.Popen[bytes]] = []

    def started(*arguments, **options):
        aborting = threading.Thread(target=blender.abort)
        aborting.start()
        aborting.join(0.1)
        made.append(popen(*arguments, **options))
        return made[0]

    popen = subprocess.Popen
    monkeypatch.setattr("legoworld.workers.child_process.subprocess.Popen", started)
    with BlenderProcess(Limits(time_s=600)) as blender:
        with pytest.raises(WorkerCrashedError):
            blender.request({"kind": "version"})
        assert made[0].poll() is not None
    assert names(temporary) == []
