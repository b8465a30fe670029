"""Images read by processes: the same bytes, and one that ends costs at most its image."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Any

import pytest
from running.run_folders import readout, results
from scene.foreign.processes import descendants

from legoworld.running import reader_process
from legoworld.running.reader_process import worth_processes
from legoworld.workers.task_process import TaskProcess

pytestmark = pytest.mark.blender

SCENES = """
for i in range(8):
    fresh(); camera()
    quad("Dog", x=i - 3, category="dog")
    save(f"scene{i}")
fresh(); quad("Dog", category="dog"); save("no_camera")
"""


@pytest.fixture
def always(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes for however few images."""
    monkeypatch.setattr(reader_process, "_WORTH_A_PROCESS", 0)
    monkeypatch.setattr(reader_process, "_MOST_THREADS", 0)


def python_children() -> set[int]:
    """Processes below this one that read images."""
    found = set()
    for pid in descendants(os.getpid()):
        try:
            command = Path(f"/proc/{pid}/cmdline").read_bytes()
        except OSError:
            continue
        if b"task_process" in command:
            found.add(pid)
    return found


def test_few_workers_and_few_images_stay_threads():
    assert not worth_processes(2, 10_000, 16)
    assert not worth_processes(16, 100, 16)
    assert not worth_processes(16, 480, 2)
    assert worth_processes(16, 480, 16)


@pytest.mark.parametrize("task", ["coco", "lvis", "eth3d"])
def test_processes_give_the_bytes_of_threads(task, scenes, tmp_path, always):
    assert readout(scenes, tmp_path / "one", "--workers", 1, task=task) == 1
    assert readout(scenes, tmp_path / "three", "--workers", 3, "--no-cache", task=task) == 1
    assert results(tmp_path / "three") == results(tmp_path / "one")
    assert not python_children()


@pytest.mark.parametrize(("most", "lost"), [(1, 0), (10_000, 9)])
def test_a_killed_process_is_replaced_once(
    most, lost, scenes, tmp_path, always, capsys, monkeypatch
):
    started: list[int] = []
    start = TaskProcess._start

    def killed(self: TaskProcess[Any, Any]) -> subprocess.Popen[bytes]:
        process = start(self)
        started.append(process.pid)
        if len(started) <= most:
            process.kill()
        return process

    with monkeypatch.context() as patch:
        patch.setattr(TaskProcess, "_start", killed)
        readout(scenes, tmp_path / "run", "--workers", 2)
    assert len(started) >= min(most, 2 * 9)
    capsys.readouterr()
    rows = (tmp_path / "run" / "per_image.jsonl").read_text()
    assert rows.count("the process that read the scene ended, twice") == lost
    assert rows.count("next: run the same command again, with fewer --workers where") == lost
    readout(scenes, tmp_path / "undisturbed", "--workers", 1)
    readout(scenes, tmp_path / "run", "--workers", 1)
    assert results(tmp_path / "run") == results(tmp_path / "undisturbed")
