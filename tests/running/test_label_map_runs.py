"""Runs of label maps: failed scenes, sky, resuming, the API, and what inspect shows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from running.run_folders import readout as readout_of
from running.run_folders import results
from scene.gltf.documents import Document

import legoworld
from legoworld import cli
from legoworld.errors import UsageError
from legoworld.evaluation.label_maps.png import read_ids


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dog before a wall, a dog alone, and a scene without a camera."""
    folder = tmp_path_factory.mktemp("scenes")
    for name in ("both", "dog", "no_camera"):
        made = Document(camera=name != "no_camera")
        made.quad("Dog", 0, 0, extras={"category": "dog"})
        if name == "both":
            made.quad("Wall", 3, 0, extras={"category": "wall"})
            made.quad("Other wall", -3, 0, extras={"coco_category": "wall-other-merged"})
        (folder / name).mkdir()
        (folder / name / "scene.glb").write_bytes(made.glb())
    return folder


@pytest.fixture(scope="module")
def track(scenes: Path) -> Path:
    names = ("both", "dog", "no_camera")
    images = [{"id": i, "file_name": f"{n}.jpg", "width": 40, "height": 30}
              for i, n in enumerate(names, 1)]  # fmt: skip
    path = scenes.parent / "track.json"
    path.write_text(json.dumps({"images": images}))
    return path


def readout(scenes: Path, track: Path, run: Path, *more: object) -> int:
    fixed = ("--source", "glb", "--no-cache", "--workers", 1, "--track", track)
    return readout_of(scenes, run, *fixed, *more, task="coco-panoptic")


def segments(run: Path) -> list[list[int]]:
    entries = json.loads((run / "answer.json").read_text())["annotations"]
    return [[s["category_id"] for s in entry["segments_info"]] for entry in entries]


def test_a_failed_scene_is_all_void_and_resuming_changes_no_byte(scenes, track, tmp_path):
    assert readout(scenes, track, tmp_path / "run") == 1
    assert segments(tmp_path / "run") == [[18, 199], [18], []]
    assert not read_ids(tmp_path / "run/answer/no_camera.png", UsageError).any()
    rows = [json.loads(x) for x in (tmp_path / "run/per_image.jsonl").read_text().splitlines()]
    assert rows[0]["matched"] == {"wall": "wall-other-merged"}
    told = [[w for w in row["warnings"] if w.startswith("things only")] for row in rows]
    assert [len(said) for said in told] == [0, 1, 0]
    before = results(tmp_path / "run", with_time=True)
    assert readout(scenes, track, tmp_path / "run") == 1
    assert results(tmp_path / "run", with_time=True) == before
    part = ("--image-id", 1)
    readout(scenes, track, tmp_path / "part", *part)
    (tmp_path / "part/answer/both.png").unlink()
    readout(scenes, track, tmp_path / "part", *part)
    for name in ("answer/both.png",):
        assert (tmp_path / "part" / name).read_bytes() == (tmp_path / "run" / name).read_bytes()


def test_sky_is_what_is_asked_for_and_on_record(scenes, track, tmp_path, capsys):
    readout(scenes, track, tmp_path / "sky", "--sky", "sky")
    assert segments(tmp_path / "sky") == [[18, 187, 199], [18, 187], []]
    ids = read_ids(tmp_path / "sky/answer/dog.png", UsageError)
    assert (ids > 0).all()
    document = json.loads((tmp_path / "sky/run.json").read_text())
    assert document["configuration"]["sky"] == "sky-other-merged"
    capsys.readouterr()
    assert readout(scenes, track, tmp_path / "sky") == 2
    assert 'sky: "sky-other-merged" -> null' in capsys.readouterr().err
    assert readout(scenes, track, tmp_path / "other", "--sky", "heaven") == 2
    assert "--sky names no category of coco-panoptic" in capsys.readouterr().err
    with pytest.raises(UsageError, match="--sky is for panoptic segments and semantic maps alone"):
        legoworld.readout(scenes, tmp_path / "boxes", task="coco", sky="sky")


def test_the_api_gives_what_the_run_has(scenes, track, tmp_path):
    readout(scenes, track, tmp_path / "run")
    scene = legoworld.open_scene(scenes / "both", source="glb", cache=False)
    view = scene.view(task="coco-panoptic", size_wh=(40, 30))
    ids, info = view.panoptic()
    assert (ids == read_ids(tmp_path / "run/answer/both.png", UsageError)).all()
    entries = json.loads((tmp_path / "run/answer.json").read_text())["annotations"]
    assert info == entries[0]["segments_info"]
    classes = view.semantic(sky="sky")
    by_id = {segment["id"]: segment["category_id"] for segment in info} | {0: 187}
    assert (classes == np.vectorize(by_id.get)(ids)).all()
    *_, only = (
        legoworld.open_scene(scenes / "dog", source="glb", cache=False)
        .view(task="coco-panoptic")
        .warnings
    )
    assert only.startswith("things only")
    with pytest.raises(UsageError, match="only a view of a task with a vocabulary"):
        scene.view().panoptic()
    with pytest.raises(UsageError, match="only a view of a task with boxes or masks"):
        view.predictions()


def test_inspect_draws_the_answer_and_says_what_is_missing(scenes, tmp_path, capsys):
    words = ["inspect", str(scenes / "dog"), "--task", "coco-panoptic", "--source", "glb"]
    assert cli.run([*words, "--no-cache", "-o", str(tmp_path / "look")]) == 0
    assert "things only" in capsys.readouterr().err
    assert (tmp_path / "look/answer.png").is_file()
