"""A worker that is ended from another thread while its own thread is closing it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

from legoworld.scene import blender_process
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.workers.task_process import TaskProcess


def sleeping() -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(600)"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


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
            reaped.append(process.returncode is not None)
        kill(pid, number)

    monkeypatch.setattr(blender_process.os, "killpg", killpg)
    aborting = threading.Thread(target=blender.abort)
    aborting.start()
    assert seen.wait(30)
    blender.close()
    closed.set()
    aborting.join()
    assert reaped == [False]
    assert process.returncode == -9


def test_a_blender_that_is_closed_is_aborted_in_peace():
    blender = BlenderProcess(Limits())
    process = blender._process = sleeping()
    blender.close()
    blender.abort()
    assert process.returncode == -9


class ClosedMeanwhile(TaskProcess):
    """Its own thread closes it right after another one has looked."""

    looks = 0

    @property
    def _process(self):
        self.looks += 1
        return self.process if self.looks == 1 else None

    @_process.setter
    def _process(self, value):
        self.process = value


def test_a_task_process_that_is_closed_meanwhile_is_aborted_in_peace():
    worker = ClosedMeanwhile(print)
    process = worker.process = sleeping()
    worker.abort()
    assert process.wait(30) == -9
    for pipe in (process.stdin, process.stdout):
        pipe.close()
