"""A worker that is ended from another thread while its own thread is closing it."""

from __future__ import annotations

import os
import sys
import threading

import pytest

from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.workers import child_process
from legoworld.workers.child_process import ChildProcess
from legoworld.workers.task_process import TaskProcess

pytestmark = pytest.mark.own_blender


def sleeping() -> ChildProcess:
    return ChildProcess([sys.executable, "-c", "import time; time.sleep(600)"], os.environ)


def test_an_abort_never_signals_a_number_that_was_reaped(monkeypatch):
    """The abort has seen that the process runs; the close is let in before the signal is sent."""
    blender = BlenderProcess(Limits())
    process = blender._process = sleeping()
    seen, closed = threading.Event(), threading.Event()
    reaped: list[bool] = []
    kill = os.killpg

    def killpg(pid, number):
        if threading.current_thread() is aborting:
            seen.set()
            closed.wait(0.5)
            reaped.append(process._process.returncode is not None)
        kill(pid, number)

    monkeypatch.setattr(child_process.os, "killpg", killpg)
    aborting = threading.Thread(target=blender.abort)
    aborting.start()
    assert seen.wait(300)
    blender.close()
    closed.set()
    aborting.join()
    assert reaped == [False]
    assert process.exit_code() == -9


def test_a_blender_that_is_closed_is_aborted_in_peace():
    blender = BlenderProcess(Limits())
    process = blender._process = sleeping()
    blender.close()
    blender.abort()
    assert process.exit_code() == -9


def test_a_task_process_that_is_closed_meanwhile_is_aborted_in_peace(monkeypatch):
    """Its own thread closes it right after another one has looked."""
    worker = TaskProcess(print)
    process = worker._process = sleeping()
    kill = process.kill

    def kill_late():
        monkeypatch.undo()
        worker.close()
        kill()

    monkeypatch.setattr(process, "kill", kill_late)
    worker.abort()
    assert worker._process is None
    assert process.exit_code() == -9
