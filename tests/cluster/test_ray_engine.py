"""The Ray engine gives the bytes of the local one, and outlives what happens to its machines."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from running.run_folders import readout, results
from waiting import PATIENCE_S

from legoworld import cli
from legoworld.workers.engines import Job, run_ray

pytest.importorskip("ray")

pytestmark = [
    pytest.mark.cluster,
    pytest.mark.blender,
    pytest.mark.filterwarnings("default"),
]

SCENES = """
for i in range(6):
    fresh(); camera()
    quad("Dog", x=i - 2, category="dog")
    save(f"scene{i}")
fresh(); quad("Dog", category="dog"); save("no_camera")
"""


def test_an_unreachable_cluster_is_said(scenes: Path, tmp_path: Path):
    """In a process of its own: in this one another test may have joined a cluster."""
    words = ["readout", str(scenes), "--task", "coco", "--engine", "ray"]
    done = subprocess.run(
        [sys.executable, "-m", "legoworld", *words, "-o", str(tmp_path / "run")],
        env={**os.environ, "RAY_ADDRESS": "127.0.0.1:1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 4, done.stderr
    assert "RAY_ADDRESS" in done.stderr


def test_same_bytes_as_the_local_engine_on_two_nodes(scenes: Path, tmp_path: Path, two_nodes):
    for task in ("coco", "lvis", "eth3d"):
        local, remote = tmp_path / f"local-{task}", tmp_path / f"ray-{task}"
        assert readout(scenes, local, "--no-cache", task=task) == 1
        assert readout(scenes, remote, "--no-cache", "--engine", "ray", task=task) == 1
        assert results(remote) == results(local)


def test_freeze_writes_the_same_records(scenes: Path, tmp_path: Path, two_nodes):
    records = {}
    for engine in ("local", "ray"):
        assert cli.run(["freeze", str(scenes), "--no-cache", "--engine", engine]) == 1
        records[engine] = {p: p.read_bytes() for p in sorted(scenes.rglob("frozen.json"))}
        for path in records[engine]:
            path.unlink()
    assert records["ray"] == records["local"]
    assert len(records["ray"]) == 7


class _Fragile:
    """Ends its own process at item 3: always, or until a file says that it did so before."""

    def __init__(self, marks: Path, once: bool) -> None:
        self._marks, self._once = marks, once

    def do(self, item: int) -> tuple[int, str]:
        mark = self._marks / str(item)
        if item == 3 and not (self._once and mark.exists()):
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return item, "done"

    def abort(self) -> None:
        pass

    def close(self) -> None:
        pass


def _lost(item: int, what: str) -> tuple[int, str]:
    return item, "lost"


@pytest.mark.parametrize(("once", "verdict"), [(True, "done"), (False, "lost")])
def test_a_lost_machine_costs_nothing_and_a_deadly_item_only_itself(
    once, verdict, tmp_path: Path, two_nodes
):
    job = Job(make=partial(_Fragile, tmp_path, once), lost_result=_lost)
    found = dict(run_ray(job, list(range(8)), workers=2))
    assert found == dict.fromkeys(range(8), "done") | {3: verdict}
