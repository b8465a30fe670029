"""Snapshots on disk: what their hash covers, and that they come back as they went."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scene.by_hand import HandScene

from legoworld.errors import SceneInvalidError
from legoworld.scene.snapshot import ARRAYS, Cutout, Snapshot, load, save


@pytest.fixture
def snapshot() -> Snapshot:
    scene = HandScene()
    scene.collection("Outer")
    scene.collection("Inner", "Outer", category="chair", lvis_category="sofa")
    scene.object("Größe / 1", collections=("Inner",), category="apple")
    scene.object("B", parent="Größe / 1")
    scene.occurs("Größe / 1")
    scene.occurs("B")
    return replace(
        scene.snapshot(),
        warnings=("something",),
        cutouts=(Cutout(name="leaf.png", wrap="clip", interpolation="linear", sides="front"),),
        triangle_cutout=np.array([0], np.int32),
        corner_uv=np.array([[[0, 0], [1, 0], [0, 1]]], np.float32),
        cutout_alphas=(np.array([[0, 255]], np.uint8),),
        corner_alpha=np.array([[0.25, 1.0, 0.5]], np.float32),
    )


def test_without_cutouts_there_is_none_of_a_triangle():
    scene = HandScene()
    scene.object("A")
    scene.occurs("A")
    plain = scene.snapshot()
    shapes = [plain.triangle_cutout.shape, plain.corner_uv.shape, plain.corner_alpha.shape]
    assert shapes == [(0,), (0, 3, 2), (0, 3)]
    assert list(plain.arrays()) == list(ARRAYS)


def test_a_snapshot_comes_back_as_it_went(snapshot, tmp_path):
    content = save(snapshot, tmp_path / "a.snapshot")
    again, read_content = load(tmp_path / "a.snapshot")
    assert content == read_content == snapshot.content_sha256() == again.content_sha256()
    for field in fields(Snapshot):
        before, after = getattr(snapshot, field.name), getattr(again, field.name)
        if isinstance(before, np.ndarray):
            assert before.dtype == after.dtype
            assert np.array_equal(before, after)
        elif field.name == "cutout_alphas":
            assert [a.tolist() for a in before] == [a.tolist() for a in after]
        else:
            assert before == after, field.name


def test_saving_again_gives_the_same_bytes(snapshot, tmp_path):
    save(snapshot, tmp_path / "a.snapshot")
    save(load(tmp_path / "a.snapshot")[0], tmp_path / "b.snapshot")
    assert (tmp_path / "a.snapshot").read_bytes() == (tmp_path / "b.snapshot").read_bytes()


def test_a_snapshot_without_cutouts_comes_back(snapshot, tmp_path):
    plain = replace(
        snapshot,
        cutouts=(),
        cutout_alphas=(),
        triangle_cutout=np.empty(0, np.int32),
        corner_uv=np.empty((0, 3, 2), np.float32),
        corner_alpha=np.empty((0, 3), np.float32),
    )
    content = save(plain, tmp_path / "a.snapshot")
    assert load(tmp_path / "a.snapshot")[0].content_sha256() == content


@pytest.mark.parametrize("name", [*ARRAYS, "triangle_cutout", "corner_uv", "corner_alpha"])
def test_the_hash_covers_every_array(snapshot, name):
    array = getattr(snapshot, name).copy()
    array.flat[0] += 1
    changed = replace(snapshot, **{name: array})
    assert changed.content_sha256() != snapshot.content_sha256()


def test_the_hash_covers_the_sides_of_a_cut_out(snapshot):
    changed = replace(snapshot, cutouts=(replace(snapshot.cutouts[0], sides="back"),))
    assert changed.content_sha256() != snapshot.content_sha256()


def test_the_hash_covers_the_alpha_pictures(snapshot):
    changed = replace(snapshot, cutout_alphas=(np.array([[0, 254]], np.uint8),))
    assert changed.content_sha256() != snapshot.content_sha256()


@pytest.mark.parametrize(
    ("field", "value"),
    [("lens_mm", 36.5), ("clip_end", 99.0), ("name", "Other"), ("sensor_fit", "VERTICAL")],
)
def test_the_hash_covers_the_camera(snapshot, field, value):
    changed = replace(snapshot, camera=replace(snapshot.camera, **{field: value}))
    assert changed.content_sha256() != snapshot.content_sha256()


def test_the_hash_covers_labels_but_not_their_order(snapshot):
    inner = snapshot.collections[1]
    turned = replace(inner, properties=dict(reversed(inner.properties.items())))
    other = replace(inner, properties={**inner.properties, "category": "tree"})
    outer = snapshot.collections[0]
    assert (
        replace(snapshot, collections=(outer, turned)).content_sha256() == snapshot.content_sha256()
    )
    assert (
        replace(snapshot, collections=(outer, other)).content_sha256() != snapshot.content_sha256()
    )


def test_the_hash_tells_a_shape_from_another(snapshot):
    flat = replace(snapshot, corner_uv=snapshot.corner_uv.reshape(1, 2, 3))
    assert flat.content_sha256() != snapshot.content_sha256()


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not a zip", b"\x00" * 500])
def test_a_file_that_is_no_snapshot_is_refused(tmp_path, content):
    (tmp_path / "a.snapshot").write_bytes(content)
    with pytest.raises(SceneInvalidError, match="cached snapshot cannot be read"):
        load(tmp_path / "a.snapshot")


def test_a_snapshot_that_is_cut_short_is_refused(snapshot, tmp_path):
    save(snapshot, tmp_path / "a.snapshot")
    whole = (tmp_path / "a.snapshot").read_bytes()
    for length in (10, len(whole) // 2, len(whole) - 1):
        (tmp_path / "b.snapshot").write_bytes(whole[:length])
        with pytest.raises(SceneInvalidError):
            load(tmp_path / "b.snapshot")
