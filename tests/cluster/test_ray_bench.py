"""The bench on a cluster of two nodes, and at URLs: the bytes of one machine."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from bench.stage import PROGRAM, picture
from evaluation.commands import files
from evaluation.reconstruction.datasets import write_dataset, write_run
from running.buckets import KINDS, empty_bucket
from running.run_folders import results

from legoworld import cli
from legoworld import remote as places
from legoworld.records.base import decode
from legoworld.records.reconstruction import ReconstructionSummary

pytest.importorskip("ray")
pytest.importorskip("fsspec")

pytestmark = [
    pytest.mark.cluster, pytest.mark.blender, pytest.mark.filterwarnings("default"),
]  # fmt: skip

RAY = ["--engine", "ray", "--workers", "2"]
QUICK = ["--size", "96x54", "--samples", "1", "--noise-seeds", "0", "-q"]
SCENES = (
    PROGRAM
    + """
for k in range(3):
    stage(); bpy.data.objects["Red"].location.x = 0.2 * k; deliver(f"room{k}")
"""
)


@pytest.fixture(scope="module")
def made(build_scenes, tmp_path_factory) -> Path:
    """Three references, their dataset, and each submitted as itself."""
    folder = tmp_path_factory.mktemp("ray-bench")
    build_scenes(SCENES, folder / "references")
    place = ["-o", str(folder / "bench")]
    assert cli.run(["bench", "make", str(folder / "references"), *place, *QUICK]) == 0
    for scene in sorted((folder / "references").iterdir()):
        target = folder / "submissions" / f"{scene.name}__view_00"
        shutil.copytree(scene, target)
        picture(target / "final.png")
    return folder


def readout(made: Path, scenes: str, run: str, *more: str) -> None:
    track = str(made / "bench" / "public" / "track.json")
    arguments = ["readout", scenes, "--task", "bench", "--track", track, "-o", run, "--no-render"]
    assert cli.run([*arguments, "--no-cache", "-q", *more]) == 0


def test_cases_are_made_and_read_on_two_nodes(made, tmp_path, two_nodes):
    place = ["-o", str(tmp_path / "bench"), "--no-cache", *RAY]
    assert cli.run(["bench", "make", str(made / "references"), *place, *QUICK]) == 0
    assert files(tmp_path / "bench") == files(made / "bench")
    readout(made, str(made / "submissions"), str(tmp_path / "local"))
    readout(made, str(made / "submissions"), str(tmp_path / "ray"), *RAY)
    assert results(tmp_path / "ray") == results(tmp_path / "local")
    assert len(results(tmp_path / "ray")) >= 3


def test_cases_are_scored_on_two_nodes(tmp_path, two_nodes, monkeypatch):
    monkeypatch.setattr("legoworld.evaluation.reconstruction.case_tasks._FEW", 1)
    dataset = write_dataset(tmp_path / "bench", views=2)
    run = str(write_run(tmp_path / "run", dataset))
    for name, more in (("local", []), ("ray", RAY)):
        arguments = ["evaluate", run, "--truth", str(dataset.private), "-o", str(tmp_path / name)]
        assert cli.run([*arguments, "--draws", "10", "-q", *more]) == 0
    assert files(tmp_path / "ray") == files(tmp_path / "local")


@pytest.fixture(params=KINDS)
def bucket(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The URL of an empty place of each kind."""
    with empty_bucket(request.param, monkeypatch) as url:
        yield url


def test_submissions_runs_and_evaluations_at_urls(made, tmp_path, bucket):
    """The same bytes as in folders, from and to an object store."""
    places.publish_folder(made / "submissions", f"{bucket}/submissions", last="")
    readout(made, str(made / "submissions"), str(tmp_path / "local"))
    readout(made, f"{bucket}/submissions", f"{bucket}/run")
    places.fetch_folder(f"{bucket}/run", tmp_path / "fetched")
    assert results(tmp_path / "fetched") == results(tmp_path / "local")
    assert "surface/room0__view_00.npz" in results(tmp_path / "fetched")
    private = str(made / "bench" / "private")
    for run, output in (
        (f"{bucket}/run", f"{bucket}/eval"), (str(tmp_path / "local"), str(tmp_path / "here")),
    ):  # fmt: skip
        arguments = ["evaluate", run, "--truth", private, "-o", output]
        assert cli.run([*arguments, "--draws", "1", "-q"]) == 0
    places.fetch_folder(f"{bucket}/eval", tmp_path / "there")
    there, here = files(tmp_path / "there"), files(tmp_path / "here")
    assert there.keys() == here.keys()
    # evidence.json alone says where its inputs are.
    assert {n for n in here if there[n] != here[n]} <= {"evidence.json"}
    assert {"per_image.jsonl", "summary.json"} < here.keys()
    assert decode(ReconstructionSummary, there["summary.json"]).metrics["R"].value == 1.0
