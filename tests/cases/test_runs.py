"""Rows 35 and 36: a run of many scenes is the same bytes every time, and grows nothing."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from legoworld import cli
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.workers.descendants import resident_bytes

pytestmark = [pytest.mark.blender, pytest.mark.own_blender]

NAMES = ("five_parts", "ring", "collection_three_times", "kinds", "particles")
#: A worker's memory may go up and down by this much from scene to scene.
NOISE_BYTES = 24 << 20


@pytest.fixture(scope="module")
def scenes(cases, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five of the built scenes under names in another order."""
    folder = tmp_path_factory.mktemp("runs")
    for number, name in enumerate(NAMES):
        (folder / f"{number:02}").mkdir()
        shutil.copyfile(cases.folder / name / "scene.blend", folder / f"{number:02}/scene.blend")
    return folder


def readout(scenes: Path, run: Path, order: list[int], *more: object) -> dict[str, bytes]:
    """Everything but run.json that a run over these images writes."""
    images = [{"id": 7 + i, "file_name": f"{i:02}.jpg", "width": 80, "height": 60} for i in order]
    track = run.with_suffix(".json")
    track.write_text(json.dumps({"info": {}, "images": images, "categories": []}))
    arguments = ["readout", "-q", scenes, "--task", "coco", "--track", track, "-o", run, *more]
    assert cli.run([str(a) for a in arguments]) == 0
    files = sorted(p for p in run.rglob("*") if p.is_file() and p.name != "run.json")
    return {str(p.relative_to(run)): p.read_bytes() for p in files}


def test_row_35_three_runs_in_other_orders_and_by_other_workers_are_the_same_bytes(
    scenes, tmp_path
):
    order = list(range(len(NAMES)))
    one = readout(scenes, tmp_path / "one", order, "--workers", 1, "--no-cache")
    two = readout(scenes, tmp_path / "two", order[::-1], "--workers", 2, "--no-cache")
    three = readout(scenes, tmp_path / "three", order[1:] + order[:1], "--workers", 2)
    assert one == two == three
    assert {"predictions.json", "per_image.jsonl", "summary.json"} <= set(one)
    assert not [name for name, content in one.items() if re.search(rb"20\d\d-\d\d-\d\d", content)]


def test_row_36_many_scenes_in_a_row_grow_no_worker_and_a_new_worker_changes_nothing(
    cases, tmp_path
):
    paths = [cases.folder / name / "scene.blend" for name in NAMES]
    answers: dict[Path, set[str]] = {path: set() for path in paths}
    with BlenderProcess(Limits(time_s=600)) as blender:

        def read_all() -> int:
            """Reads every scene; the number of the process that did."""
            for path in paths:
                request = {"kind": "snapshot", "blend": str(path), "output": str(tmp_path / "s")}
                answers[path].add(blender.request(request)["content_sha256"])
            assert blender._process is not None
            return blender._process.pid

        settled = resident_bytes([read_all() for _ in range(3)][-1])
        worker = [read_all() for _ in range(5)][-1]
        assert resident_bytes(worker) - settled < NOISE_BYTES
        blender.close()
        assert read_all() != worker
    assert all(len(contents) == 1 for contents in answers.values())
