"""`legoworld score`: from a program or a scene to the findings of one photo, in one command."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from legoworld import cli

PROGRAM = """
import bpy
for made in list(bpy.data.objects):
    bpy.data.objects.remove(made)
scene = bpy.context.scene
scene.render.resolution_x, scene.render.resolution_y = 64, 48
data = bpy.data.cameras.new("Camera")
scene.camera = bpy.data.objects.new("Camera", data)
scene.camera.location.z = 10
scene.collection.objects.link(scene.camera)
bpy.ops.mesh.primitive_plane_add(size=2)
bpy.context.object["category"] = "cat"
"""


def write_truth(path: Path) -> Path:
    """Two photos; the first holds the plane of the program, and a dog it does not have."""
    from legoworld.readouts.family import protocol

    categories = protocol("coco", None).vocabulary.categories
    cat, dog = ({"category_id": n, "iscrowd": 0} for n in (17, 18))
    boxes = [({**cat}, [23, 15, 18, 18]), ({**dog}, [2, 2, 9, 9])]
    document = {
        "images": [
            {"id": 7, "file_name": "desk.png", "width": 64, "height": 48},
            {"id": 9, "file_name": "other.png", "width": 64, "height": 48},
        ],
        "categories": [{"id": c.id, "name": c.name} for c in categories],
        "annotations": [
            {"id": i, "image_id": 7, "bbox": box, "area": box[2] * box[3], **entry}
            for i, (entry, box) in enumerate(boxes, 1)
        ],
    }
    path.write_text(json.dumps(document))
    return path


@pytest.fixture
def given(tmp_path, monkeypatch):
    """The options of a photo and its truth, in an empty working folder."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    photo = tmp_path / "desk.png"
    cv2.imwrite(str(photo), np.full((48, 64, 3), 90, np.uint8))
    return ["--photo", str(photo), "--truth", str(write_truth(tmp_path / "truth.json"))]


@pytest.mark.blender
def test_a_program_is_scored_in_one_command(given, tmp_path, capsys):
    (tmp_path / "desk.py").write_text(PROGRAM)
    kept = tmp_path / "kept"
    assert cli.run(["score", str(tmp_path / "desk.py"), *given, "-o", str(kept)]) == 0
    shown = capsys.readouterr().out
    assert "AP 0.5" in shown
    assert "bad: missed: 1 x dog; do: build it" in shown
    assert f"overlay -> {kept}/look/overlay.png" in shown
    assert len(shown.splitlines()) <= 7
    for name in ("scene/scene.blend", "run/predictions.json", "eval/evidence.json", "report.html"):
        assert (kept / name).is_file(), name
    before = sorted(p.name for p in (kept / "scene").iterdir())

    assert cli.run(["score", str(kept / "scene"), *given, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert sorted(document) == [
        "advice", "execution", "overlay", "row", "schema_version", "summary",
    ]  # fmt: skip
    assert document["row"]["image_id"] == 7
    assert document["execution"] is None
    assert Path(document["overlay"]) == Path("legoworld-runs/desk-coco-overlay.png")
    assert [p.name for p in Path().rglob("*.*")] == ["desk-coco-overlay.png"]
    assert sorted(p.name for p in (kept / "scene").iterdir()) == before, "a scene is only read"


def test_a_scene_without_a_result_is_said(given, tmp_path, capsys):
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / "scene.glb").write_bytes(b"")
    assert cli.run(["score", str(tmp_path / "scene"), *given]) == 1
    shown = capsys.readouterr().out
    assert shown.startswith("invalid: desk.png: the scene folder holds no scene.blend")
    assert not Path("legoworld-runs").exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--image", "9999"], "the ground truth has no such image; found: '9999'"),
        (["--photo", "{here}/stranger.png"], "the ground truth lists no photo of this name"),
        (["--photo", "{here}/sub/desk.png"], "desk.png is not the photo of image 7; found: 10x10"),
        (["--task", "eth3d"], "the ground truth of depth is a folder"),
    ],
)
def test_what_cannot_be_scored_is_one_line(given, tmp_path, more, message, capsys):
    (tmp_path / "sub").mkdir()
    for name in ("stranger.png", "sub/desk.png"):
        cv2.imwrite(str(tmp_path / name), np.zeros((10, 10, 3), np.uint8))
    (tmp_path / "scene").mkdir()
    words = [word.format(here=tmp_path) for word in more]
    assert cli.run(["score", str(tmp_path / "scene"), *given, *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_the_help_says_that_an_agent_must_not_run_it(capsys):
    assert cli.run(["score", "-h"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "an agent that builds scenes must not run it or see its output" in shown
