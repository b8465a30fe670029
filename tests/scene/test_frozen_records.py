"""frozen.json: what it records, what differs from it, and files outside of SCENES."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from legoworld import __version__
from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import NotFrozenError, SceneChangedError, SceneInvalidError
from legoworld.records.scene_folder import OK, Verdict
from legoworld.scene import freeze
from legoworld.scene.folder import SceneFolder, leaves_scenes, outside_name, recorded_name
from legoworld.scene.freeze import (
    FrozenFiles,
    checked_artefacts,
    hash_files,
    hashed_dependencies,
    write_frozen,
)
from legoworld.scene.side_files import program_warnings


@pytest.fixture
def scene(tmp_path):
    folder = tmp_path / "scenes" / "x"
    folder.mkdir(parents=True)
    for name in ("scene.blend", "labels.json", "arm.urdf", "wood.png"):
        (folder / name).write_text(name)
    return SceneFolder(path=folder, name="x")


def freeze_now(scene, **checks):
    artefacts = hash_files(scene.path, scene.artefacts())
    write_frozen(scene, artefacts, hash_files(scene.path, ["wood.png"]), checks, bpy="5.0")
    return json.loads((scene.path / "frozen.json").read_text())


def test_what_a_record_holds(scene):
    record = freeze_now(scene, **{"scene.blend": OK})
    assert (record["schema_version"], record["legoworld"]) == (SCHEMA_VERSION, __version__)
    assert record["checks"] == {"scene.blend": {"status": "ok", "code": "ok", "reason": None}}
    assert record["status"] == "ok"
    assert record["bpy"] == "5.0"
    assert record["files"].keys() == {"scene.blend", "labels.json", "arm.urdf"}
    assert record["files"]["arm.urdf"]["bytes"] == 8
    assert record["dependencies"].keys() == {"wood.png"}
    assert record["covers"] == [
        "scene.blend", "scene.glb", "final.png", "scene.py", "labels.json", "provenance.json",
    ]  # fmt: skip
    bad = Verdict(status="invalid", code="c", reason="r")
    assert freeze_now(scene, **{"scene.blend": OK, "final.png": bad})["status"] == "invalid"


def test_a_complaint_and_no_record_matter_where_a_record_is_required(scene):
    with pytest.raises(NotFrozenError, match="the scene is not frozen"):
        checked_artefacts(scene, require_frozen=True)
    assert checked_artefacts(scene, require_frozen=False).frozen == "at_readout"
    freeze_now(scene, **{"final.png": Verdict(status="invalid", code="c", reason="r")})
    assert checked_artefacts(scene, require_frozen=False).frozen == "frozen.json"
    with pytest.raises(NotFrozenError, match=r"found: frozen.json says invalid"):
        checked_artefacts(scene, require_frozen=True)
    freeze_now(scene)
    assert list(checked_artefacts(scene, require_frozen=True).dependencies) == ["wood.png"]


@pytest.mark.parametrize("name", ["scene.blend", "labels.json", "arm.urdf", "wood.png"])
def test_each_file_of_the_record_is_compared(name, scene):
    freeze_now(scene)
    path = scene.path / name
    path.write_text("else")
    with pytest.raises(SceneChangedError) as caught:
        checked_artefacts(scene, require_frozen=False)
    assert caught.value.what == f"{name} is not the file that was frozen"
    now, then = (hash_files(scene.path, [name])[name] for _ in range(2))
    assert caught.value.found == f"sha256 {now.sha256[:16]}"
    path.unlink()
    with pytest.raises(SceneChangedError, match="found: no file; expected: sha256 "):
        checked_artefacts(scene, require_frozen=False)
    path.write_text(name)
    checked_artefacts(scene, require_frozen=False)
    assert then == now


@pytest.mark.parametrize("name", ["scene.glb", "provenance.json", "leg.urdf"])
def test_a_file_that_appeared_is_a_change(name, scene):
    freeze_now(scene)
    (scene.path / name).write_text("{}")
    with pytest.raises(SceneChangedError, match=rf"{name} is.*found: sha256 .*expected: no file"):
        checked_artefacts(scene, require_frozen=False)


def test_a_folder_that_is_read_is_no_file(scene):
    (scene.path / "baked").mkdir()
    assert hash_files(scene.path, ["baked", "baked/0", "wood.png/0"]) == {
        "baked": None, "baked/0": None, "wood.png/0": None,
    }  # fmt: skip
    (scene.path / "scene.glb").mkdir()
    with pytest.raises(SceneInvalidError, match=r"scene\.glb cannot be read"):
        hash_files(scene.path, ["scene.glb"])
    with pytest.raises(SceneInvalidError, match="cannot be read"):
        hash_files(scene.path, ["a\0b"])


def test_the_size_limit_is_the_largest_that_is_read(scene, monkeypatch):
    monkeypatch.setattr(freeze, "LARGEST_BYTES", 8)
    assert hash_files(scene.path, ["wood.png"])["wood.png"].bytes == 8
    monkeypatch.setattr(freeze, "LARGEST_BYTES", 7)
    with pytest.raises(SceneInvalidError, match="8 bytes, limit 7"):
        hash_files(scene.path, ["wood.png"])


def test_the_hash_of_a_scene_is_that_of_all_its_files(scene):
    known = FrozenFiles(artefacts={}, dependencies={}, frozen="at_readout")
    hashed = hash_files(scene.path, ["wood.png"])
    by_role = [
        known,
        FrozenFiles(artefacts=hashed, dependencies={}, frozen="at_readout"),
        FrozenFiles(artefacts={}, dependencies=hashed, frozen="at_readout"),
        FrozenFiles(artefacts={}, dependencies={"wood.png": None}, frozen="at_readout"),
    ]
    assert len({files.sha256 for files in by_role}) == 4
    again = FrozenFiles(artefacts={}, dependencies={}, frozen="frozen.json", warnings=("w",))
    assert again.sha256 == known.sha256


def test_a_file_outside_is_compared_when_the_scene_file_has_named_it(scene, tmp_path):
    outside = tmp_path / "wood.png"
    outside.write_text("oak")
    unknown = FrozenFiles(artefacts={}, dependencies={}, frozen="at_readout", warnings=("w",))
    path = str(outside)
    listed = hashed_dependencies(scene, [path, "wood.png"], unknown, read_by="scene.blend")
    assert list(listed.dependencies) == [outside_name(path), "wood.png"]
    assert listed.warnings == ("w",)
    write_frozen(scene, hash_files(scene.path, scene.artefacts()), listed.dependencies, {})
    record = checked_artefacts(scene, require_frozen=False)
    for read_by in ("scene.blend", "scene.glb"):
        now = hashed_dependencies(scene, [path, "wood.png"], record, read_by=read_by)
        assert (now.dependencies, now.warnings) == (listed.dependencies, ())
    fewer = hashed_dependencies(scene, ["wood.png"], record, read_by="scene.blend")
    assert fewer.warnings == (
        "frozen.json lists wood.png, which scene.blend does not read: freeze the scene again, so "
        "that it can be read on other machines",
    )
    assert hashed_dependencies(scene, ["wood.png"], record, read_by="scene.glb").warnings == ()
    outside.write_text("elm")
    with pytest.raises(SceneChangedError, match="outside://"):
        hashed_dependencies(scene, [path, "wood.png"], record, read_by="scene.blend")
    with pytest.raises(SceneInvalidError, match=r"found: outside://\w{16}/other.png; expected"):
        hashed_dependencies(scene, ["/other.png"], record, read_by="scene.blend")


def test_a_name_on_record_says_no_path():
    scene = SceneFolder(path=Path("a"), name="x")
    for path, name in (("/home/alice/wood.png", "wood.png"), ("C:\\alice\\a b.png", "a b.png"),
                       ("../../alice/wood.png", "wood.png")):  # fmt: skip
        recorded = recorded_name(path, scene)
        assert recorded == outside_name(path)
        assert recorded.endswith(f"/{name}")
        assert len(recorded) == len("outside://") + 16 + 1 + len(name)
        assert "alice" not in recorded
        assert recorded_name(recorded, scene) == recorded
    assert outside_name("/a/x.png") != outside_name("/b/x.png")


STOPPED = {"status": "stopped", "error": {"type": "ValueError", "message": "m", "line": 7}}


@pytest.mark.parametrize(
    ("record", "warning"),
    [
        (STOPPED, "stopped at line 7 (ValueError): the scene is what it had built by then"),
        ({**STOPPED, "error": {**STOPPED["error"], "line": None}}, "stopped (ValueError): "),
        ({"status": "stopped"}, "stopped (an error): "),
        ({**STOPPED, "status": "complete"}, None),
        ({**STOPPED, "files": {"scene.blend": "1" * 64}}, None),
        ({**STOPPED, "files": {}}, None),
    ],
)
def test_a_program_that_was_stopped_is_a_warning_of_its_scene(record, warning, scene):
    blend = hash_files(scene.path, ["scene.blend"])["scene.blend"].sha256
    document = {"files": {"scene.blend": blend}, **record}
    (scene.path / "execution.json").write_text(json.dumps(document))
    found = program_warnings(scene.path, blend)
    assert checked_artefacts(scene, require_frozen=False).warnings == found
    freeze_now(scene)
    assert checked_artefacts(scene, require_frozen=False).warnings == found
    if warning is None:
        assert found == ()
    else:
        assert len(found) == 1
        assert f"the program that built the scene {warning}" in found[0]


def test_an_execution_json_that_cannot_be_used_is_a_warning(scene):
    assert program_warnings(scene.path, None) == ()
    (scene.path / "execution.json").write_text("[]")
    (warning,) = program_warnings(scene.path, None)
    assert warning.startswith("execution.json cannot be used; found: ")


def test_what_leaves_the_scenes():
    scene = SceneFolder(path=Path("a"), name="courtyard/images/x")
    inside = ("tex.png", "../tex.png", "../../../tex.png", "outside/x", "a..b")
    outside = ("../../../../tex.png", "/tex.png", "C:\\tex.png", "outside://12/tex.png")
    assert not any(leaves_scenes(name, scene) for name in inside)
    assert all(leaves_scenes(name, scene) for name in outside)
    assert [recorded_name(name, scene) for name in inside] == [*inside]


@pytest.mark.parametrize("frozen_as", [".", "coffee"])
@pytest.mark.parametrize("read_as", [".", "coffee"])
def test_a_scene_frozen_by_itself_is_read_among_others(frozen_as, read_as, tmp_path):
    folder = tmp_path / "coffee"
    folder.mkdir()
    (tmp_path / "tex.png").write_bytes(b"a picture")
    unknown = FrozenFiles(artefacts={}, dependencies={}, frozen="at_readout")
    frozen = SceneFolder(path=folder, name=frozen_as)
    listed = hashed_dependencies(frozen, ["../tex.png"], unknown, read_by="scene.blend")
    record = FrozenFiles(artefacts={}, dependencies=listed.dependencies, frozen="frozen.json")
    scene = SceneFolder(path=folder, name=read_as)
    now = hashed_dependencies(scene, ["../tex.png"], record, read_by="scene.blend")
    assert now.dependencies == record.dependencies
    assert now.warnings == ()
