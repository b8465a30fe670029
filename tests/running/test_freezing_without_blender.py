"""`legoworld freeze` of one scene: its checks, its warnings, and what is not put on record."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from scene.gltf.documents import Document
from scene.stand_in import StandIn

from legoworld.running.freeze_run import freeze_scene
from legoworld.scene.cache import SnapshotCache, bpy_version
from legoworld.scene.folder import SceneFolder

GOOD = {"status": "ok", "code": "ok", "reason": None}


def picture(*shades: int) -> bytes:
    values = np.array(shades, np.uint8).repeat(3).reshape(1, -1, 3)
    return cv2.imencode(".png", values)[1].tobytes()


@pytest.fixture
def scene(tmp_path):
    made = Document()
    made.quad("Chair", 0, 0)
    folder = tmp_path / "scenes" / "room"
    folder.mkdir(parents=True)
    for name in ("scene.blend", "scene.glb"):
        (folder / name).write_bytes(made.glb())
    (folder / "final.png").write_bytes(picture(0, 9))
    (folder / "labels.json").write_text('{"version": 1, "labels": []}')
    (folder / "provenance.json").write_text('{"agent": "a"}')
    (folder / "wood.png").write_bytes(b"wood")
    return SceneFolder(path=folder, name="room")


def frozen(scene, blender=None, cache=None):
    with blender or StandIn() as process:
        row = freeze_scene(scene, blender=process, cache=cache)
    path = scene.path / "frozen.json"
    return row, json.loads(path.read_text()) if path.is_file() else None


def test_a_scene_whose_files_are_all_good(scene, tmp_path):
    (scene.path / ".frozen.json.1.tmp").write_text("of a killed freeze")
    row, record = frozen(scene, cache=SnapshotCache(tmp_path / "cache"))
    assert (row.scene, row.status, row.warnings) == ("room", "ok", [])
    assert {check.status for check in row.checks.values()} == {"ok"}
    names = {"scene.blend", "scene.glb", "final.png", "labels.json", "provenance.json"}
    assert row.checks.keys() == record["files"].keys() == names
    assert record["checks"] == dict.fromkeys(names, GOOD)
    assert record["dependencies"].keys() == {"wood.png"}
    assert (record["status"], record["bpy"]) == ("ok", bpy_version())
    assert list((tmp_path / "cache").rglob("*.snapshot"))


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("scene.glb", b"glTF", "unreadable_gltf"),
        ("final.png", picture(5, 5), "invalid_scene"),
        ("labels.json", b"[]", "invalid_labels"),
        ("provenance.json", b"3", "invalid_side_file"),
        ("scene.blend", Document().glb(), "no_mesh"),
    ],
)
def test_each_file_has_a_check_of_its_own(name, content, code, scene):
    (scene.path / name).write_bytes(content)
    row, record = frozen(scene)
    assert row.status == record["status"] == "invalid"
    assert [n for n, check in row.checks.items() if check.status != "ok"] == [name]
    assert record["checks"][name]["code"] == row.checks[name].code == code
    assert row.checks[name].reason
    assert name in record["files"]


def test_a_file_that_cannot_be_hashed_is_a_failed_check(scene):
    (scene.path / "final.png").unlink()
    (scene.path / "final.png").mkdir()
    row, record = frozen(scene)
    assert row.status == "invalid"
    assert "final.png cannot be read" in row.checks["final.png"].reason
    assert "final.png" not in record["files"]


def test_a_process_that_is_lost_says_nothing_of_the_scene(scene):
    row, record = frozen(scene, StandIn(lost=1))
    assert (row.status, record) == ("invalid", None)
    assert row.checks["scene.blend"].code == "worker_crashed"
    assert row.checks["scene.glb"].status == "ok"


def test_what_does_not_move_with_the_scene_is_warned_of(scene, tmp_path):
    class Elsewhere(StandIn):
        def request(self, message):
            answer = super().request(message)
            return {**answer, "dependencies": [str(tmp_path / "oak.png"), "/absent.png"]}

    (tmp_path / "oak.png").write_bytes(b"oak")
    row, record = frozen(scene, Elsewhere())
    assert row.status == "ok"
    assert row.warnings == [
        "scene.blend reads oak.png from outside of the scenes: on another machine the scene is "
        "not this one; pack the file into the .blend or put it beside it"
    ]
    assert sorted(name.rpartition("/")[2] for name in record["dependencies"]) == [
        "absent.png", "oak.png",
    ]  # fmt: skip


def test_a_program_that_was_stopped_is_warned_of(scene):
    digest = frozen(scene)[1]["files"]["scene.blend"]["sha256"]
    document = {"status": "stopped", "files": {"scene.blend": digest}}
    (scene.path / "execution.json").write_text(json.dumps(document))
    row, _ = frozen(scene)
    assert row.status == "ok"
    assert len(row.warnings) == 1
    assert "the program that built the scene stopped" in row.warnings[0]
