"""`legoworld freeze` and `legoworld inspect`."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scene.gltf.documents import Document

from legoworld import cli
from legoworld.files import TEMPORARY_SUFFIX
from legoworld.scene.cache import bpy_version

pytestmark = pytest.mark.blender

SCENES = """
fresh(); camera()
quad("Dog", category="dog")
quad("Far dog", x=100, category="dog")
quad("Wall", z=-2, half=9)
save("good")
fresh(); quad("Dog"); save("no_camera")
fresh(); camera()
for name, x, label in (("A", 0, "dogg"), ("B", 2, "dogg"), ("C", -2, "xyzzy")):
    quad(name, x=x, category=label)
save("odd_labels")
"""


def frozen(scene: Path) -> dict:
    return json.loads((scene / "frozen.json").read_text())


def write_picture(path: Path, picture: np.ndarray) -> None:
    assert cv2.imwrite(str(path), picture)


def test_freeze_checks_every_artefact(scenes, capsys, monkeypatch):
    monkeypatch.setattr("legoworld.commands.progress._FIRST_S", 0.0)
    monkeypatch.setattr("legoworld.commands.progress._LINE_S", 0.0)
    noise = np.random.default_rng(0).integers(0, 255, (8, 8, 3), np.uint8)
    write_picture(scenes / "good" / "final.png", noise)
    (scenes / "good" / "scene.py").write_text("# the program")
    assert cli.run(["freeze", str(scenes), "--json"]) == 1
    out, err = capsys.readouterr()
    document = json.loads(out)
    found = {row["scene"]: row["status"] for row in document["scenes"]}
    assert found == {"good": "ok", "no_camera": "invalid", "odd_labels": "ok"}
    said = [line.partition(" s")[0] for line in err.splitlines()]
    assert said == ["1 of 3", "2 of 3", "3 of 3"]
    record = frozen(scenes / "good")
    assert set(record["files"]) == {"scene.blend", "final.png", "scene.py"}
    blend = scenes / "good" / "scene.blend"
    assert record["files"]["scene.blend"]["bytes"] == blend.stat().st_size
    assert frozen(scenes / "no_camera")["checks"]["scene.blend"]["code"] == "no_camera"


def test_each_artefact_has_its_verdict(scenes, tmp_path, capsys):
    noise = np.random.default_rng(0).integers(0, 255, (8, 8, 3), np.uint8)
    for name in ("good", "odd"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.blend").write_bytes((scenes / "good/scene.blend").read_bytes())
        (tmp_path / name / "scene.py").write_text("# the program")
        write_picture(tmp_path / name / "final.png", noise)
    glb = Document()
    glb.quad("Dog", 0, 0)
    (tmp_path / "good" / "scene.glb").write_bytes(glb.glb())
    (tmp_path / "good" / "labels.json").write_text('{"version": 1, "labels": []}')
    (tmp_path / "good" / "provenance.json").write_text("{}")
    for file in ("scene.glb", "labels.json", "provenance.json"):
        (tmp_path / "odd" / file).write_text("neither")
    (tmp_path / "odd" / f".frozen.json.1{TEMPORARY_SUFFIX}").touch()  # of a killed freeze
    assert cli.run(["freeze", str(tmp_path), "--json"]) == 1
    good, odd = json.loads(capsys.readouterr().out)["scenes"]
    fine = {"status": "ok", "code": "ok", "reason": None}
    judged = ("scene.blend", "scene.glb", "final.png", "labels.json", "provenance.json")
    assert good == {
        "scene": "good", "status": "ok", "checks": dict.fromkeys(judged, fine), "warnings": []
    }  # fmt: skip
    assert (odd["scene"], odd["status"]) == ("odd", "invalid")
    assert {name: check["code"] for name, check in odd["checks"].items()} == {
        "scene.blend": "ok",
        "final.png": "ok",
        "scene.glb": "unreadable_gltf",
        "labels.json": "invalid_labels",
        "provenance.json": "invalid_side_file",
    }
    for name, row in (("good", good), ("odd", odd)):
        record = frozen(tmp_path / name)
        assert record["checks"] == row["checks"]
        assert record["status"] == row["status"]
        assert set(record["files"]) == {*judged, "scene.py"}
        assert record["dependencies"] == {}
        assert record["bpy"] == bpy_version()
        for file, found in record["files"].items():
            content = (tmp_path / name / file).read_bytes()
            assert found == {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}
    assert [path.name for path in (tmp_path / "odd").glob(".*")] == []


@pytest.mark.own_blender
def test_a_limit_that_is_reached_makes_no_record(scenes, tmp_path, capsys):
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "scene.blend").write_bytes((scenes / "good/scene.blend").read_bytes())
    arguments = ["freeze", str(tmp_path), "--json", "--memory-limit", "0.1", "--no-cache"]
    assert cli.run(arguments) == 1
    (row,) = json.loads(capsys.readouterr().out)["scenes"]
    assert (row["status"], row["checks"]["scene.blend"]["code"]) == ("invalid", "worker_memory")
    assert not (tmp_path / "s" / "frozen.json").exists()


def test_scenes_are_frozen_by_name_by_several_workers(scenes, tmp_path, capsys):
    for name in "dbca":
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.blend").write_bytes((scenes / "good/scene.blend").read_bytes())
    assert cli.run(["freeze", str(tmp_path), "--json", "--workers", "2"]) == 0
    rows = json.loads(capsys.readouterr().out)["scenes"]
    assert [row["scene"] for row in rows] == [*"abcd"]
    assert len({(tmp_path / name / "frozen.json").read_bytes() for name in "abcd"}) == 1
    assert cli.run(["freeze", str(tmp_path)]) == 0
    assert capsys.readouterr().out == "4 of 4 scenes frozen, all checks passed\n"


@pytest.mark.parametrize("content", [b"", b"not a picture", "flat"])
def test_freeze_refuses_a_picture_that_shows_nothing(content, scenes, tmp_path, capsys):
    scene = tmp_path / "s"
    scene.mkdir()
    (scene / "scene.blend").write_bytes((scenes / "good" / "scene.blend").read_bytes())
    if content == "flat":
        write_picture(scene / "final.png", np.full((8, 8, 3), 7, np.uint8))
    else:
        (scene / "final.png").write_bytes(content)
    assert cli.run(["freeze", str(tmp_path)]) == 1
    assert "final.png" in capsys.readouterr().out
    assert frozen(scene)["status"] == "invalid"


def test_inspect_writes_buffers_that_agree_with_its_table(scenes, tmp_path):
    arguments = ["inspect", str(scenes / "good"), "--size", "64x48", "-q", "-o", str(tmp_path)]
    assert cli.run(arguments) == 0
    buffers = np.load(tmp_path / "buffers.npz")
    instance, depth = buffers["instance"], buffers["depth_z_m"]
    assert (instance.dtype, depth.dtype) == (np.int32, np.float32)
    assert instance.shape == depth.shape == (48, 64)
    np.testing.assert_array_equal(np.isinf(depth), instance == -1)
    document = json.loads((tmp_path / "instances.json").read_text())
    entries = {e["objects"][0]: e for e in document["instances"]}
    assert entries["Dog"]["area_px"] == 144
    assert entries["Dog"]["bbox_xywh_px"] == [26, 18, 12, 12]
    assert entries["Far dog"]["reason"] == "outside_view"
    assert entries["Wall"]["labelled"] is False
    for entry in entries.values():
        assert entry["area_px"] == (instance == entry["id"]).sum()
    assert set(depth[instance == entries["Dog"]["id"]]) == {np.float32(10)}
    for name in ("overlay.png", "depth.png"):
        assert cv2.imread(str(tmp_path / name)).shape == (48, 64, 3)


def test_inspect_draws_over_a_photo_of_its_size_only(scenes, tmp_path, capsys):
    photo = tmp_path / "photo.png"
    write_picture(photo, np.full((48, 64, 3), 90, np.uint8))
    good = ["inspect", str(scenes / "good"), "--photo", str(photo), "-q", "-o", str(tmp_path / "a")]
    assert cli.run(good) == 0
    assert cli.run([*good, "--size", "32x24"]) == 2
    assert "have different sizes" in capsys.readouterr().err


def test_inspect_of_a_broken_scene_is_one_line(scenes, capsys):
    assert cli.run(["inspect", str(scenes / "no_camera")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_inspect_resolves_labels_in_a_tracks_own_vocabulary(scenes, tmp_path, capsys):
    track = tmp_path / "track.json"
    document = {
        "info": {"task": "coco"},
        "images": [{"id": 1, "file_name": "a.png", "width": 64, "height": 48}],
        "categories": [{"id": 1, "name": "dogg"}],
    }
    track.write_text(json.dumps(document))
    scene = str(scenes / "odd_labels")
    assert cli.run(["inspect", scene, "--track", str(track), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert {e["category"] for e in shown["instances"] if e["labelled"]} == {"dogg"}
    assert "dogg" not in shown["outside_vocabulary"]


def test_inspect_names_what_a_label_is_like(scenes, capsys):
    scene = str(scenes / "odd_labels")
    assert cli.run(["inspect", scene, "--task", "coco"]) == 0
    shown = capsys.readouterr().out
    assert "label 'dogg' is not in the vocabulary (2 owners); near: dog" in shown
    assert "label 'xyzzy' is not in the vocabulary (1 owner)\n" in shown
    assert cli.run(["inspect", scene, "--task", "coco", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["outside_vocabulary"] == {"dogg": 2, "xyzzy": 1}
    assert document["nearest"]["dogg"][0] == "dog"
    assert document["nearest"]["xyzzy"] == []
    assert cli.run(["inspect", scene]) == 0
    assert "vocabulary" not in capsys.readouterr().out


@pytest.fixture
def re_executed(scenes, tmp_path) -> Path:
    """A frozen scene whose scene.blend was made anew."""
    scene = tmp_path / "scenes" / "again"
    scene.mkdir(parents=True)
    (scene / "scene.blend").write_bytes((scenes / "good" / "scene.blend").read_bytes())
    assert cli.run(["freeze", "-q", str(scene)]) == 0
    (scene / "scene.blend").write_bytes((scenes / "odd_labels" / "scene.blend").read_bytes())
    return scene


def test_inspect_of_a_changed_scene_says_what_to_do(re_executed, capsys):
    before = frozen(re_executed)
    capsys.readouterr()
    assert cli.run(["inspect", str(re_executed)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "scene.blend is not the file that was frozen" in error
    assert "`legoworld freeze` the scene again" in error
    assert "--allow-changed" in error
    assert frozen(re_executed) == before


def test_a_changed_scene_can_be_looked_at_and_not_read_out(re_executed, tmp_path, capsys):
    before = frozen(re_executed)
    arguments = ["inspect", str(re_executed), "--allow-changed"]
    assert cli.run([*arguments, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [e["name"] for e in document["instances"]] == ["A", "B", "C"]
    warning = "scene.blend is not the file that was frozen: readout refuses the scene until"
    assert warning in document["warnings"][0]
    assert cli.run(arguments) == 0
    assert f"warning: {warning}" in capsys.readouterr().err
    assert frozen(re_executed) == before
    readout = ["readout", "-q", str(re_executed.parent), "--task", "coco", "-o"]
    assert cli.run([*readout, str(tmp_path / "run")]) == 1
    assert "changed: again" in capsys.readouterr().out
    assert cli.run([*readout, str(tmp_path / "other"), "--allow-changed"]) == 2
    assert cli.run([*arguments, "--compare-sources"]) == 2
    assert cli.run(["freeze", "-q", str(re_executed)]) == 0
    capsys.readouterr()
    assert cli.run([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"] == []


def test_a_change_that_is_not_of_the_files_is_never_allowed(re_executed, capsys):
    (re_executed / "frozen.json").write_text("{")
    assert cli.run(["inspect", str(re_executed), "--allow-changed"]) == 2
    assert "frozen.json cannot be used" in capsys.readouterr().err
