"""Scenes that cannot be read: each has its verdict, and none becomes an empty scene."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from scene.snapshots import build, snapshot_of

from legoworld.errors import LegoWorldError
from legoworld.readouts.family import protocol
from legoworld.records.base import canonical
from legoworld.running.image import read_image
from legoworld.running.image_record import ImageOptions
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import hash_files, write_frozen
from legoworld.tracks.track import TrackImage

pytestmark = pytest.mark.blender


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("bad") / "scenes", "scene.bad_scenes")


@pytest.fixture(scope="module")
def blender() -> Iterator[BlenderProcess]:
    with BlenderProcess(Limits(time_s=600)) as process:
        yield process


@pytest.fixture
def read(scenes: Path, blender: BlenderProcess, tmp_path: Path):
    def read(name: str, folder: Path = scenes) -> dict[str, Any]:
        options = ImageOptions(
            scenes=folder,
            run=tmp_path,
            protocol=protocol("coco", None),
            source="blend",
            cache=SnapshotCache(tmp_path / "cache"),
            require_frozen=False,
            max_side=None,
            threads=1,
        )
        image = TrackImage(id=1, file_name=f"{name}.jpg", size_wh=(80, 60), scene=name)
        return json.loads(canonical(read_image(image, options, blender)))

    return read


def test_the_good_scene_is_read(read):
    record = read("good")
    assert (record["row"]["status"], record["row"]["reason"]) == ("ok", None)
    assert [p["bbox"] for p in record["predictions"]] == [[10, 10, 20, 20]]


VERDICTS = {
    "no_camera": ("no_camera", "no camera object"),
    "cameras_none_active": ("no_camera", "2 camera objects, none active: Camera, Camera.001"),
    "camera_is_an_empty": ("no_camera", "empty object 'Eye'"),
    "panoramic": ("unsupported_camera", "camera type PANO"),
    "flat_camera": ("unsupported_camera", "a scale of 0"),
    "reversed_clip": ("unsupported_camera", "clip_start 10, clip_end 1"),
    "infinite_camera": ("non_finite_geometry", "a place beyond 1e+15"),
    "no_mesh": ("no_mesh", "2 objects, none with a visible face"),
    "only_hidden_meshes": ("no_mesh", "3 objects, none with a visible face"),
    "only_loose_edges": ("no_mesh", "2 objects, none with a visible face"),
    "broken_vertices": ("non_finite_geometry", "2 of 4 vertices hold NaN, infinity"),
    "infinite_matrix": ("non_finite_geometry", "object 'Chair' stands nowhere"),
    "far_away": ("non_finite_geometry", "object 'Chair' stands nowhere"),
}


@pytest.mark.parametrize(("name", "verdict"), VERDICTS.items(), ids=VERDICTS)
def test_a_scene_that_cannot_be_read_has_its_verdict(read, name, verdict):
    record = read(name)
    row = record["row"]
    code, found = verdict
    assert (row["status"], row["code"]) == ("invalid", code)
    assert found in row["reason"]
    for part in ("; found: ", "; expected: ", "; next: "):
        assert part in row["reason"]
    assert record["predictions"] == []
    assert "Traceback" not in row["reason"]


def test_what_is_not_drawn_may_be_broken(read):
    row = read("hidden_and_broken")["row"]
    assert (row["status"], row["n_predictions"]) == ("ok", 1)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"this is not a blend file\n",
        b"BLENDER-v405",
        b"BLENDER-v405" + bytes(1000),
        b"BLENDER17-01v0500" + b"\xff" * 1000,
        b"\x28\xb5\x2f\xfd" + bytes(100),  # as a compressed file begins
        b"\x1f\x8b\x08" + bytes(100),
    ],
    ids=["empty", "text", "header", "zeros", "noise", "zstd", "gzip"],
)
def test_a_file_that_is_no_blend_has_its_verdict(read, tmp_path, content):
    folder = tmp_path / "scenes" / "odd"
    folder.mkdir(parents=True)
    (folder / "scene.blend").write_bytes(content)
    row = read("odd", tmp_path / "scenes")["row"]
    assert (row["status"], row["code"]) == ("invalid", "unreadable_blend")
    assert str(tmp_path) not in row["reason"]


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.99])
def test_a_truncated_file_has_its_verdict(read, scenes, tmp_path, share):
    whole = (scenes / "good" / "scene.blend").read_bytes()
    folder = tmp_path / "scenes" / "cut"
    folder.mkdir(parents=True)
    (folder / "scene.blend").write_bytes(whole[: int(share * len(whole))])
    row = read("cut", tmp_path / "scenes")["row"]
    assert (row["status"], row["code"]) == ("invalid", "unreadable_blend")


def test_the_process_serves_on_after_bad_files(read):
    assert read("no_camera")["row"]["status"] == "invalid"
    assert read("good")["row"]["status"] == "ok"


def test_an_unreadable_labels_json_has_its_verdict(read, scenes, tmp_path):
    folder = tmp_path / "scenes" / "labelled"
    shutil.copytree(scenes / "good", folder)
    (folder / "labels.json").write_bytes(b"\xff\xfe")
    row = read("labelled", tmp_path / "scenes")["row"]
    assert (row["status"], row["code"]) == ("invalid", "invalid_labels")


def test_properties_that_are_no_text_are_no_labels(read, scenes, blender):
    record = read("odd_labels")
    row = record["row"]
    assert row["status"] == "ok"
    assert [p["bbox"] for p in record["predictions"]] == [[20, 0, 8, 8]]  # bytes are text
    assert row["warnings"][:3] == [
        "'Thing 0' has a property 'category' that is not text: not a label",
        "'Thing 0' has a property 'coco_category' that is not text: not a label",
        "'Thing 1' has a property 'category' that is not text: not a label",
    ]
    properties = {
        o.name: o.properties for o in snapshot_of(scenes / "odd_labels", blender).snapshot.objects
    }
    assert properties["Thing 3"] == {"category": "3"}
    assert properties["Thing 4"] == {"category": "True"}


@pytest.fixture
def linking(scenes: Path, tmp_path: Path) -> Path:
    """A copy of the scene with libraries that may be changed."""
    shutil.copytree(scenes / "linking", tmp_path / "scenes" / "linking")
    return tmp_path / "scenes" / "linking"


def test_linked_libraries_are_read_and_hashed(read, linking):
    record = read("linking", linking.parent)
    assert [p["bbox"] for p in record["predictions"]] == [[35, 25, 10, 10]]
    assert sorted(record["scene"]["dependencies"]) == ["inner.blend", "outer.blend"]


@pytest.mark.parametrize("name", ["outer.blend", "inner.blend"])
def test_a_missing_library_is_an_invalid_scene(read, linking, name):
    (linking / name).unlink()
    row = read("linking", linking.parent)["row"]
    assert (row["status"], row["code"]) == ("invalid", "missing_library")
    assert f"'{name}' does not exist" in row["reason"]


def test_a_library_that_cannot_be_read_is_an_invalid_scene(read, linking):
    (linking / "outer.blend").write_bytes(b"no library")
    row = read("linking", linking.parent)["row"]
    assert (row["status"], row["code"]) == ("invalid", "missing_library")


def test_a_changed_library_gives_a_fresh_snapshot(read, linking, scenes):
    before = read("linking", linking.parent)
    shutil.copy(scenes / "linking" / "larger.blend", linking / "outer.blend")
    after = read("linking", linking.parent)
    assert [p["bbox"] for p in after["predictions"]] == [[30, 20, 20, 20]]
    assert before["row"]["files_sha256"] != after["row"]["files_sha256"]
    assert before["row"]["snapshot_sha256"] != after["row"]["snapshot_sha256"]


@pytest.mark.parametrize("name", ["outer.blend", "inner.blend", "scene.blend"])
def test_a_changed_file_of_a_frozen_scene_is_not_read(read, linking, blender, name):
    scene = SceneFolder(path=linking, name="linking")
    dependencies = snapshot_of(linking, blender).files.dependencies
    write_frozen(scene, hash_files(linking, scene.artefacts()), dependencies, {})
    assert read("linking", linking.parent)["row"]["status"] == "ok"
    with (linking / name).open("ab") as stream:
        stream.write(b"\0")
    row = read("linking", linking.parent)["row"]
    assert (row["status"], row["code"]) == ("changed", "changed")
    assert name in row["reason"]


def test_every_verdict_says_what_was_found_expected_and_next():
    error = LegoWorldError("what", found="found", expected="expected", next_step="next")
    assert str(error) == "what; found: found; expected: expected; next: next"
