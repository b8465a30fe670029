"""Scenes and runs at URLs: the same bytes as in folders of this machine."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from running.buckets import KINDS, empty_bucket
from running.run_folders import readout, results

from legoworld import cli
from legoworld import remote as places

pytest.importorskip("fsspec")

pytestmark = pytest.mark.blender

SCENES = """
for i in range(3):
    fresh(); camera()
    quad("Dog", x=i - 2, category="dog")
    save(f"street/scene{i}")
"""


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory, build_scenes) -> Path:
    folder = tmp_path_factory.mktemp("made") / "scenes"
    folder.mkdir()
    build_scenes(SCENES, folder)
    (folder / "street" / "scene1" / "labels.json").write_text(
        '{"version": 1, "labels": [{"object": "Dog", "category": "cat"}]}'
    )
    return folder


@pytest.fixture(params=KINDS)
def bucket(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The URL of an empty place of each kind."""
    with empty_bucket(request.param, monkeypatch) as url:
        yield url


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("task", ["coco", "eth3d"])
def test_same_bytes_from_and_to_a_url(task, scenes: Path, tmp_path: Path, bucket: str):
    places.publish_folder(scenes, f"{bucket}/scenes", last="")
    assert readout(scenes, tmp_path / "local", task=task) == 0
    assert readout(f"{bucket}/scenes", f"{bucket}/run", task=task) == 0
    places.fetch_folder(f"{bucket}/run", tmp_path / "fetched")
    assert results(tmp_path / "fetched") == results(tmp_path / "local")
    assert any("cat" in str(r) for r in results(tmp_path / "local").values()) or task != "coco"


@pytest.mark.filterwarnings("default")
def test_a_run_at_a_url_goes_on_on_another_machine(
    scenes: Path, tmp_path: Path, bucket: str, monkeypatch, capsys
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "first"))
    readout(scenes, f"{bucket}/run")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "second"))
    arguments = [str(scenes), "--task", "coco", "-o", f"{bucket}/run"]
    capsys.readouterr()
    assert cli.run(["readout", *arguments]) == 0
    assert "3 of 3 images have a valid result already" in capsys.readouterr().err


@pytest.mark.filterwarnings("default")
def test_shards_at_urls_are_merged(scenes: Path, tmp_path: Path, bucket: str):
    readout(scenes, tmp_path / "whole")
    for i in (1, 2):
        readout(scenes, f"{bucket}/shards/{i}", "--shard", f"{i}/2")
    shards = [f"{bucket}/shards/{i}" for i in (1, 2)]
    assert cli.run(["merge", *shards, "-o", str(tmp_path / "merged")]) == 0
    assert results(tmp_path / "merged") == results(tmp_path / "whole")


@pytest.mark.filterwarnings("default")
def test_files_of_predictions_at_a_url(scenes: Path, tmp_path: Path, bucket: str):
    local = tmp_path / "local"
    for run in (local, f"{bucket}/run"):
        assert readout(scenes, run, "--images-per-file", 2) == 0
    places.fetch_folder(f"{bucket}/run", tmp_path / "fetched")
    assert results(tmp_path / "fetched") == results(local)
    assert len(list((local / "predictions").iterdir())) == 2
    merge = ["merge", f"{bucket}/run", "-o", f"{bucket}/whole"]
    assert cli.run(merge) == 0
    assert readout(scenes, tmp_path / "whole") == 0
    places.fetch_folder(f"{bucket}/whole", tmp_path / "merged")
    assert results(tmp_path / "merged") == results(tmp_path / "whole")
    # Published again with another division, nothing of the first one stays there.
    assert readout(scenes, f"{bucket}/run", "--overwrite") == 0
    places.fetch_folder(f"{bucket}/run", tmp_path / "anew")
    assert results(tmp_path / "anew") == results(tmp_path / "whole")


@pytest.mark.filterwarnings("default")
def test_inspect_looks_at_a_scene_at_a_url(scenes: Path, bucket: str, tmp_path: Path, capsys):
    places.publish_folder(scenes, f"{bucket}/scenes", last="")
    shown = []
    for scene in (scenes / "street/scene1", f"{bucket}/scenes/street/scene1"):
        output = tmp_path / f"look{len(shown)}"
        assert cli.run(["inspect", str(scene), "--json", "-o", str(output)]) == 0
        files = {p.name: p.read_bytes() for p in output.iterdir()}
        shown.append((json.loads(capsys.readouterr().out), files))
    assert shown[0] == shown[1]
    assert shown[0][0]["instances"][0]["category"] == "cat"
    assert cli.run(["inspect", f"{bucket}/scenes/street/scene9"]) == 2
    assert "is empty or does not exist" in capsys.readouterr().err
    assert cli.run(["inspect", f"{bucket}/scenes/street"]) == 2
    assert "holds no scene" in capsys.readouterr().err


def test_file_urls_are_paths(scenes: Path, tmp_path: Path):
    assert readout(scenes.as_uri(), (tmp_path / "run").as_uri()) == 0
    assert (tmp_path / "run" / "run.json").is_file()


def test_a_url_that_cannot_be_reached_is_one_line(tmp_path: Path, capsys):
    assert readout("nowhere://bucket/scenes", tmp_path / "run") == 4
    error = capsys.readouterr().err
    assert "nowhere://bucket/scenes cannot be reached" in error
    assert error.count("\n") == 1


def test_an_empty_url_holds_no_scene(tmp_path: Path, capsys):
    assert readout("memory://nothing/scenes", tmp_path / "run") == 2
    assert "no scene.blend or scene.glb below memory://nothing/scenes" in capsys.readouterr().err
