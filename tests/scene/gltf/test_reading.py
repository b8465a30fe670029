"""`--source glb` through the scene folder: hashes, cache, freezing, and no Blender."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scene.gltf.documents import Document, png_of_alpha
from scene.gltf.scenes import NoBlender

from legoworld import cli
from legoworld.errors import LegoWorldError, SceneChangedError, SceneInvalidError
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import checked_artefacts, write_frozen
from legoworld.scene.gltf.verdicts import UnreadableGltfError
from legoworld.scene.read_scene import read_scene
from legoworld.scene.snapshot import save


def read(folder, cache=None, files=None):
    scene = SceneFolder(path=folder, name=folder.name)
    files = files or checked_artefacts(scene, require_frozen=False)
    return read_scene(scene, source="glb", blender=NoBlender(Limits()), cache=cache, files=files)


@pytest.fixture
def folder(tmp_path):
    made = Document()
    made.quad("Chair", 4, 4, extras={"category": "chair"})
    path = tmp_path / "scene"
    path.mkdir()
    (path / "scene.glb").write_bytes(made.glb())
    return path


def with_picture(folder, alpha):
    """A card whose texture lies beside scene.glb."""
    made = Document()
    made.textured_quad(
        {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}},
        [(0, 1), (1, 1), (1, 0), (0, 0)],
    )
    made.json["textures"] = [{"source": 0}]
    made.json["images"] = [{"uri": "leaf.png"}]
    (folder / "scene.glb").write_bytes(made.glb())
    (folder / "leaf.png").write_bytes(png_of_alpha(alpha))


def test_with_and_without_a_cache_the_same_snapshot(folder, tmp_path):
    cache = SnapshotCache(tmp_path / "cache")
    without, first, second = read(folder), read(folder, cache), read(folder, cache)
    assert without.snapshot_sha256 == first.snapshot_sha256 == second.snapshot_sha256
    assert second.snapshot.content_sha256() == without.snapshot_sha256
    assert without.files == first.files == second.files


def test_the_second_reading_comes_from_the_cache(folder, tmp_path, monkeypatch):
    cache = SnapshotCache(tmp_path / "cache")
    read(folder, cache)
    monkeypatch.setattr("legoworld.scene.gltf.container.parse_glb", None)
    read(folder, cache)
    with pytest.raises(TypeError):
        read(folder)


def test_files_beside_it_are_part_of_the_key_and_of_the_record(folder, tmp_path):
    cache = SnapshotCache(tmp_path / "cache")
    with_picture(folder, [[0, 255]])
    first = read(folder, cache)
    assert list(first.files.dependencies) == ["leaf.png"]
    assert first.snapshot.cutout_alphas[0].tolist() == [[0, 255]]
    (folder / "leaf.png").write_bytes(png_of_alpha([[255, 0]]))
    second = read(folder, cache)
    assert second.snapshot.cutout_alphas[0].tolist() == [[255, 0]]
    assert first.files.sha256 != second.files.sha256
    (folder / "leaf.png").unlink()
    third = read(folder, cache)
    assert third.files.dependencies == {"leaf.png": None}
    assert third.snapshot.cutouts == ()


def test_frozen_scenes(folder):
    scene = SceneFolder(path=folder, name="scene")
    files = checked_artefacts(scene, require_frozen=False)
    write_frozen(scene, files.artefacts, {}, {})
    assert read(folder).files.frozen == "frozen.json"
    whole = (folder / "scene.glb").read_bytes()
    (folder / "scene.glb").write_bytes(whole[:-1] + b"\1")
    with pytest.raises(SceneChangedError):
        read(folder)


def test_frozen_json_must_vouch_for_files_beside_it(folder):
    scene = SceneFolder(path=folder, name="scene")
    with_picture(folder, [[0, 255]])
    files = checked_artefacts(scene, require_frozen=False)
    write_frozen(scene, files.artefacts, {}, {})
    with pytest.raises(SceneInvalidError, match=r"frozen\.json does not list"):
        read(folder)
    write_frozen(scene, files.artefacts, read(folder, files=files).files.dependencies, {})
    assert read(folder).snapshot.cutouts


def test_a_file_that_changes_meanwhile_and_a_folder_without_one(folder):
    scene = SceneFolder(path=folder, name="scene")
    before = checked_artefacts(scene, require_frozen=False)
    whole = (folder / "scene.glb").read_bytes()
    (folder / "scene.glb").write_bytes(whole + b"\0\0\0\0")
    with pytest.raises(SceneInvalidError, match="changed while it was read"):
        read(folder, files=before)
    with pytest.raises(UnreadableGltfError):
        read(folder)
    (folder / "scene.glb").unlink()
    with pytest.raises(SceneInvalidError, match=r"holds no scene\.glb"):
        read(folder)


def test_a_readout_of_glb_files_alone(folder, tmp_path, capsys):
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "scene.glb").write_bytes(b"glTF is not here" * 3)
    output = tmp_path.with_name(tmp_path.name + "-run")
    code = cli.run([
        "readout", "-q", str(tmp_path), "--task", "coco", "--source", "glb", "--no-cache",
        "-o", str(output),
    ])  # fmt: skip
    capsys.readouterr()
    assert code == 1
    rows = {
        row["scene"]: row
        for row in map(json.loads, (output / "per_image.jsonl").read_text().splitlines())
    }
    assert (rows["bad"]["status"], rows["bad"]["code"]) == ("invalid", "unreadable_gltf")
    assert rows["scene"]["status"] == "ok"
    assert any("records no picture size" in w for w in rows["scene"]["warnings"])
    (prediction,) = json.loads((output / "predictions.json").read_text())
    scale = 1080 / 64
    assert prediction["category_id"] == 62
    assert np.allclose(prediction["bbox"], np.array([36, 20, 8, 8]) * scale, atol=1)


def test_every_verdict_is_one_line_with_a_next_step(folder):
    (folder / "scene.glb").write_bytes(b"glTF")
    with pytest.raises(LegoWorldError) as verdict:
        read(folder)
    assert "\n" not in str(verdict.value)
    assert "next: export the scene again" in str(verdict.value)


def test_a_picture_that_changes_while_it_is_read_is_no_scene(folder, monkeypatch):
    from legoworld.scene.gltf import snapshot as gltf_snapshot

    with_picture(folder, np.full((2, 2), 255, np.uint8))
    original = gltf_snapshot.read_glb_snapshot

    def replacing(*arguments, **named):
        made = original(*arguments, **named)
        (folder / "leaf.png").write_bytes(png_of_alpha(np.zeros((2, 2), np.uint8)))
        return made

    monkeypatch.setattr(gltf_snapshot, "read_glb_snapshot", replacing)
    with pytest.raises(SceneInvalidError, match="changed while it was read"):
        read(folder)


def test_a_blend_that_changes_while_it_is_read_is_no_scene(folder, tmp_path):
    class Replacing(BlenderProcess):
        def request(self, message):
            snapshot = read(folder).snapshot
            save(snapshot, Path(message["output"]))
            (folder / "scene.blend").write_bytes(b"another, of other content")
            return {"dependencies": []}

    (folder / "scene.blend").write_bytes(b"the one that was hashed")
    scene = SceneFolder(path=folder, name=folder.name)
    files = checked_artefacts(scene, require_frozen=False)
    cache = SnapshotCache(tmp_path / "cache")
    with (
        Replacing(Limits()) as blender,
        pytest.raises(SceneInvalidError, match="changed while it was read"),
    ):
        read_scene(scene, source="blend", blender=blender, cache=cache, files=files)
    assert not list((tmp_path / "cache").rglob("*.snapshot"))
