"""Submissions and datasets that are wrong in ways that come: verdicts or one line, never a loss."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from bench.quick_renders import few_samples
from bench.stage import PROGRAM, picture
from evaluation.reconstruction.datasets import write_dataset, write_run

from legoworld import cli
from legoworld.errors import WorkerCrashedError
from legoworld.records.base import UNSET, decode_lines
from legoworld.records.bench_results import ServeAnswer
from legoworld.records.submission import BenchRow
from legoworld.scene.blender_process import BlenderProcess

FILLED = (
    "the camera's view is filled by one object: 'Wall' covers 100 % of the hits at 1.1 m and hides "
    "2 other objects, 5.7 times as far: move the camera out of it"
)

SCENES = (
    PROGRAM
    + """
stage(); deliver("reference/room")
stage(); deliver("good")
stage(); box("Wall", 0.0, -6.0, 2.0, 1.0); deliver("inside_a_wall")
scene = stage(); scene.render.resolution_x, scene.render.resolution_y = 36, 64; deliver("tall")
stage()
m = bpy.data.materials.new("Photo"); m.use_nodes = True
bpy.data.objects["Red"].data.materials.append(m)
deliver("absolute")
for name, path in (("a", "/srv/agents/someone/a.png"), ("b", "//../../srv/agents/someone/b.png")):
    image = bpy.data.images.new(name, 4, 4)
    image.source, image.filepath_raw = "FILE", path
    m.node_tree.nodes.new("ShaderNodeTexImage").image = image
bpy.ops.wm.save_mainfile(relative_remap=False)
stage(); bpy.data.objects["Red"].data.vertices[0].co.x = float("nan"); save("nan")
stage(); bpy.data.objects["Red"].name = "Other"; bpy.data.objects["Floor"].name = "Ground"
deliver("renamed")
"""
)


@pytest.fixture(scope="module")
def folder(build_scenes, tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("bad-input")
    build_scenes(SCENES, place)
    quick = ["--size", "96x54", "--samples", "1", "--noise-seeds", "0", "-q"]
    assert cli.run(["bench", "make", str(place / "reference"), "-o", str(place / "b"), *quick]) == 0
    shutil.copyfile(place / "good" / "scene.glb", place / "nan" / "scene.glb")
    for name in ("glb_of_another_scene", "flat_picture"):
        shutil.copytree(place / "good", place / name)
    for scene in place.iterdir():
        picture(scene / "final.png")
    cv2.imwrite(str(place / "flat_picture" / "final.png"), np.full((54, 96, 3), 90, np.uint8))
    shutil.copyfile(
        place / "renamed" / "scene.glb", place / "glb_of_another_scene" / "scene.glb"
    )  # fmt: skip
    (place / "empty").mkdir()
    return place


@pytest.fixture(scope="module")
def answers(folder) -> dict[str, ServeAnswer]:
    """What `bench serve` says of each submission."""
    names = ["good", "inside_a_wall", "tall", "absolute", "nan", "glb_of_another_scene",
             "flat_picture", "empty"]  # fmt: skip
    lines = [json.dumps({"scene": str(folder / n), "image_id": 1, "id": n}) for n in names]
    done = subprocess.run(
        [sys.executable, "-m", "legoworld", "bench", "serve", str(folder / "b"), "--root", "/",
         "--no-render",
         "--workers", "1"],
        input="\n".join(lines) + "\n", capture_output=True, text=True, check=True,
        env={**os.environ},
    )  # fmt: skip
    found = {str(a.id): a for a in decode_lines(ServeAnswer, done.stdout.encode())}
    assert set(found) == set(names)
    return found


@pytest.mark.parametrize(
    ("name", "valid", "r", "words"),
    [
        ("good", 1, 1.0, ""),
        ("inside_a_wall", 1, 0.0, ""),
        ("tall", 1, 1.0, ""),  # the reference's intrinsics: another aspect costs A alone
        ("absolute", 1, 1.0, ""),
        ("glb_of_another_scene", 1, 1.0, "it may be of another scene"),
        ("nan", 0, 0.0, "vertices hold NaN"),
        ("flat_picture", 0, 0.0, "final.png"),
        ("empty", 0, 0.0, "an empty folder"),
    ],
)
def test_every_submission_has_its_verdict(answers, name, valid, r, words):
    answer = answers[name]
    assert (valid, r) == (answer.V, answer.R)
    told = " ".join([answer.reason or "", *answer.warnings])
    assert words in told
    assert "\n" not in told


def test_a_camera_in_a_wall_and_another_aspect_are_rendered_too(
    folder, track_for, tmp_path, capsys, monkeypatch
):
    """A camera in a wall is valid, and told what it sees."""
    few_samples(monkeypatch)
    track = track_for(tmp_path / "track.json", ["inside_a_wall", "tall", "absolute"])
    run = tmp_path / "run"
    arguments = ["readout", str(folder), "--task", "bench", "--track", str(track)]
    assert cli.run([*arguments, "-o", str(run)]) == 0
    assert f"warning: inside_a_wall.png: {FILLED}" in capsys.readouterr().err
    rows = decode_lines(BenchRow, (run / "per_image.jsonl").read_bytes())
    for row in rows:
        assert row.valid is True
        assert row.render is not UNSET
        assert row.render.size_wh == (512, 288)
    images = [image for row in rows if row.integrity for image in row.integrity.images]
    assert [(i.path, i.absolute_path) for i in images] == [("a.png", True), ("b.png", False)]
    (pink,) = (row for row in rows if row.scene == "absolute")
    assert any("'a' cannot be read" in w and "a.png, an absolute path" in w for w in pink.warnings)
    warned = {row.scene: row.warnings for row in rows if row is not pink}
    assert warned.pop("tall") == ()
    assert warned == {"inside_a_wall": (FILLED,)}
    for path in run.rglob("*.json*"):
        assert b"/srv/agents" not in path.read_bytes()


def test_a_blend_that_crashes_blender_is_its_own_verdict(folder, track_for, tmp_path, monkeypatch):
    """Asked for twice, in a fresh process the second time; the other submissions are read."""
    asked = []
    request = BlenderProcess.request

    def crashing(self, message):
        if "/crashes/" in str(message.get("blend")):
            asked.append(message["kind"])
            raise WorkerCrashedError("Blender ended", found="signal 11", expected="a snapshot")
        return request(self, message)

    monkeypatch.setattr(BlenderProcess, "request", crashing)
    scenes = tmp_path / "scenes"
    for name in ("crashes", "good"):
        shutil.copytree(folder / "good", scenes / name)
    track = track_for(tmp_path / "track.json", ["crashes", "good"])
    arguments = ["readout", str(scenes), "--task", "bench", "--track", str(track), "-q"]
    assert cli.run([*arguments, "-o", str(tmp_path / "run"), "--no-render", "--no-cache"]) == 1
    rows = decode_lines(BenchRow, (tmp_path / "run" / "per_image.jsonl").read_bytes())
    crashed, good = sorted(rows, key=lambda row: row.scene)
    assert asked == ["snapshot", "snapshot"]
    assert (crashed.status, crashed.code, crashed.valid) == ("failed", "worker_crashed", False)
    assert crashed.validity
    assert crashed.validity.scene_blend.found == "Blender ended: signal 11"
    assert crashed.validity.scene_glb.ok
    assert (good.status, good.valid) == ("ok", True)


@pytest.mark.parametrize("wrong", ["another_half", "edited_track", "no_half"])
def test_a_dataset_that_does_not_belong_is_one_line(tmp_path, capsys, wrong):
    dataset = write_dataset(tmp_path / "bench")
    run = write_run(tmp_path / "run", dataset)
    truth = dataset.private
    if wrong == "another_half":
        other = write_dataset(tmp_path / "other", seed=1, tiers=("easy", "medium"))
        shutil.rmtree(truth)
        shutil.copytree(other.private, truth)
    elif wrong == "edited_track":
        track = dataset.root / "public" / "track.json"
        track.write_text(track.read_text().replace("50.0", "60.0"))
    else:
        shutil.rmtree(truth)
        truth.mkdir()
    out = str(tmp_path / "eval")
    assert cli.run(["evaluate", str(run), "--truth", str(truth), "-o", out]) not in (0, 1)
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    words = {"another_half": "another dataset", "edited_track": "its track was edited",
             "no_half": "DATASET/public beside it"}  # fmt: skip
    assert words[wrong] in said
    assert not (tmp_path / "eval").exists()
