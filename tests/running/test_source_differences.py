"""scene.blend beside scene.glb, instance by instance, both read from files made by hand."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as replace_row
from scene.by_hand import VOCABULARY
from scene.gltf.documents import Document
from scene.gltf.scenes import NoBlender

from legoworld.errors import LegoWorldError, SceneChangedError
from legoworld.running import source_comparison
from legoworld.running.inspection import OpenScene, label, look, open_scene, write_inspection
from legoworld.running.source_comparison import compare_sources
from legoworld.scene.blender_process import Limits
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import checked_artefacts, write_frozen
from legoworld.scene.snapshot import SceneCollection

#: name, x, y, side and category of squares in a picture of 64 x 64 pixels.
SQUARES = (("Chair", 4, 4, 8, "chair"), ("Apple", -20, 4, 4, "apple"), ("Rock", -20, -20, 6, None))


def load(folder, squares=SQUARES, **options):
    made = Document()
    for name, x, y, side, category in squares:
        made.quad(name, x, y, side, extras={"category": category} if category else {})
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.glb").write_bytes(made.glb())
    return opened_again(folder, **options)


def opened_again(folder, **options):
    scene = SceneFolder(path=folder, name=folder.name)
    with NoBlender(Limits()) as blender:
        return open_scene(scene, source="glb", blender=blender, cache=None, **options)


def looked_at(scene, size_wh=(64, 64)):
    return look(label(scene, VOCABULARY, None), size_wh=size_wh, threads=1)


def change_snapshot(scene: OpenScene, **parts) -> OpenScene:
    """Other values in the parts of its snapshot."""
    snapshot = scene.scene.snapshot
    made = {
        name: replace(getattr(snapshot, name), **value) if isinstance(value, dict) else value
        for name, value in parts.items()
    }
    return replace(scene, scene=replace(scene.scene, snapshot=replace(snapshot, **made)))


def diff(blend, glb):
    return compare_sources(looked_at(blend), looked_at(glb))


def test_the_same_scene_twice(tmp_path):
    hidden = (*SQUARES, ("Far", 500, 500, 4, "tree"))
    found = diff(*(load(tmp_path / name, hidden) for name in "ab"))
    assert [(p.name, p.blend_category, p.glb_category, p.iou) for p in found.pairs] == [
        ("Apple", "apple", "apple", 1.0), ("Chair", "chair", "chair", 1.0),
        ("Rock", None, None, 1.0),
    ]  # fmt: skip
    assert [(p.blend_area_px, p.glb_area_px) for p in found.pairs] == [(16, 16), (64, 64), (36, 36)]
    assert (found.lost, found.gained, found.differences) == ((), (), ())
    assert found.unseen == 1  # Far
    assert (found.differing_px, found.n_disagreeing, found.faithful) == (0, 0, True)


def test_an_instance_that_moved_and_one_of_each_side(tmp_path):
    moved = (("Chair", 6, 4, 8, "chair"), SQUARES[1], ("Tree", -20, -20, 6, "tree"))
    found = diff(load(tmp_path / "a"), load(tmp_path / "b", moved))
    # The one that differs first, then by name.
    assert [(p.name, p.iou) for p in found.pairs] == [("Chair", 48 / 80), ("Apple", 1.0)]
    assert [e.name for e in found.lost] == ["Rock"]
    assert [e.name for e in found.gained] == ["Tree"]
    assert (found.differing_px, found.n_disagreeing, found.faithful) == (32 + 36, 1, False)


def test_a_pair_at_the_limit_agrees(tmp_path):
    """A column of 1,000 of which one pixel is gone: an IoU of exactly .999."""
    wide = (("Wall", -20, 5, 10, None), ("Aisle", 0, 0, 4, None))
    blend, glb = (load(tmp_path / name, wide) for name in "ab")
    ours, theirs = looked_at(blend), looked_at(glb)
    rows = {row.name: row for row in ours.entries}
    overlap = {rows["Wall"].id: 999, rows["Aisle"].id: 16}
    partners = [(i, i, n) for i, n in sorted(overlap.items())]
    entries = tuple(replace_row(row, area_px=1000) if row.name == "Wall" else row
                    for row in ours.entries)  # fmt: skip
    smaller = tuple(replace_row(row, area_px=999) if row.name == "Wall" else row
                    for row in theirs.entries)  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source_comparison, "_partners", lambda *_: partners)
        for side, rows_of_side in ((ours, entries), (theirs, smaller)):
            vars(side)["entries"] = rows_of_side
        found = compare_sources(ours, theirs)
    assert {p.name: p.iou for p in found.pairs} == {"Aisle": 1.0, "Wall": 0.999}
    assert [p.name for p in found.pairs] == ["Aisle", "Wall"]  # both agree: by name
    assert found.n_disagreeing == 0


def test_another_category_alone_is_not_faithful(tmp_path):
    other = (SQUARES[0], ("Apple", -20, 4, 4, "tree"), SQUARES[2])
    found = diff(load(tmp_path / "a"), load(tmp_path / "b", other))
    assert (found.differing_px, found.n_disagreeing, found.lost) == (0, 0, ())
    assert not found.faithful
    hidden = (*SQUARES, ("Far", 500, 500, 4, "tree"))
    found = diff(load(tmp_path / "a"), load(tmp_path / "c", hidden))
    assert [e.name for e in found.gained] == ["Far"]
    assert found.faithful  # no pixel shows it


def test_instances_of_one_name_are_matched_by_the_largest_overlap(tmp_path):
    blend = (("Leaf", 0, 0, 8, None), ("Leaf", 20, 0, 8, None), ("Leaf", -20, 0, 4, None))
    # Of the first two's places, shifted; and one where none was.
    glb = (("Leaf", 21, 0, 8, None), ("Leaf", 3, 0, 8, None), ("Leaf", 0, 20, 2, None))
    found = diff(load(tmp_path / "a", blend), load(tmp_path / "b", glb))
    assert sorted((p.blend_area_px, p.glb_area_px, p.iou) for p in found.pairs) == [
        (16, 4, 0.0), (64, 64, 40 / 88), (64, 64, 56 / 72),
    ]  # fmt: skip
    assert (found.lost, found.gained) == ((), ())
    fewer = diff(load(tmp_path / "a", blend), load(tmp_path / "c", glb[:1]))
    assert [p.iou for p in fewer.pairs] == [56 / 72]
    assert [e.area_px for e in fewer.lost] == [64, 16]


@pytest.mark.parametrize(
    ("ours", "said"),
    [
        ({"camera": {"name": "Eye"}}, "the camera is 'Camera', not 'Eye'"),
        ({"camera": {"shift_x": 0.25}}, "lens shift 0.25, 0 is lost"),
        ({"camera": {"shift_y": -0.5}}, "lens shift 0, -0.5 is lost"),
        ({"render": {"pixel_aspect_x": 2.0}}, "the pixel aspect is lost"),
        ({"render": {"unit_scale": 0.01}}, "the unit scale is lost: 1 unit is 0.01 m, in glTF 1 m"),
        ({"surface_holdout": np.array([1, 0, 1], np.uint8)},
         "2 holdout surfaces are ordinary surfaces"),
    ],
)  # fmt: skip
def test_what_a_gltf_cannot_store_is_said(ours, said, tmp_path):
    found = diff(change_snapshot(load(tmp_path / "a"), **ours), load(tmp_path / "b"))
    assert said in found.differences
    others = [d for d in found.differences if d != said]
    assert all(d.startswith(("the projection's", "depth is")) for d in others)


def test_counts_and_projections_that_differ_are_said(tmp_path):
    more = (*SQUARES, ("Tree", -4, -20, 6, "tree"))
    found = diff(load(tmp_path / "a"), load(tmp_path / "b", more))
    assert found.differences == ("6 triangles became 8",)
    wide = change_snapshot(load(tmp_path / "a"), camera={"ortho_scale": 128.0})
    assert diff(wide, load(tmp_path / "b", SQUARES)).differences == (
        "the projection's fx is 1.000 px, not 0.500",
        "the projection's fy is 1.000 px, not 0.500",
    )
    shifted = change_snapshot(load(tmp_path / "a"), camera={"shift_x": 0.5, "shift_y": 0.25})
    assert diff(load(tmp_path / "b"), shifted).differences == (
        "the projection's cx is 0.000 px, not 32.000",
        "the projection's cy is 48.000 px, not 32.000",
    )


def test_labels_of_collections_that_no_node_carries_are_said(tmp_path):
    def collection(name, **labels):
        return SceneCollection(name=name, library=None, parents=(), properties=labels)

    held = tuple(collection(name, category="tree") for name in ("Chair", "Grove", "Rock", "Hedge"))
    ours = change_snapshot(load(tmp_path / "a"), collections=(*held, collection("Plain")))
    # Chair comes as a labelled node, Rock as one without a label.
    assert diff(ours, load(tmp_path / "b")).differences == (
        "labels of collections are lost: Grove, Rock, Hedge",
    )
    many = tuple(collection(f"C{i}", category="tree") for i in range(12))
    (said,) = diff(change_snapshot(ours, collections=many), load(tmp_path / "b")).differences
    assert said.endswith("C8, C9")


def test_another_pose_and_another_depth_are_said(tmp_path):
    here = load(tmp_path / "a")
    pose = here.scene.snapshot.camera.world_from_camera

    def moved_by(distance):
        rows = tuple((*row[:3], row[3] - distance * row[2]) for row in pose)
        return change_snapshot(here, camera={"world_from_camera": rows})

    found = diff(moved_by(10.0), load(tmp_path / "b"))
    assert found.differences == (
        "the camera stands 10 units away, its axes differ by up to 0",
        "depth is 0.5 times scene.blend's (median)",
    )
    assert diff(moved_by(1e-5), here).differences == ()
    turned = tuple((-row[0], -row[1], *row[2:]) for row in pose)
    about = change_snapshot(here, camera={"world_from_camera": turned})
    assert "the camera stands 0 units away, its axes differ by up to 2" in (
        diff(about, here).differences
    )


def test_what_an_inspection_writes(tmp_path):
    made = load(tmp_path / "scene", (*SQUARES, ("Odd", 40, 40, 2, "chairs")))
    scene = look(label(made, VOCABULARY, None), size_wh=None, threads=1)
    assert scene.outside_vocabulary == {"chairs": 1}
    assert scene.nearest["chairs"][0] == "chair"
    assert scene.view.size_wh == (1080, 1080)  # a square camera's own
    small = looked_at(opened_again(tmp_path / "scene"), (64, 32))
    assert "the scene's own picture is 1080x1080: another aspect than 64x32" in small.warnings
    assert len(looked_at(opened_again(tmp_path / "scene")).warnings) == len(small.warnings) - 1
    write_inspection(small, tmp_path / "out", None)
    document = json.loads((tmp_path / "out" / "instances.json").read_text())
    assert document["schema_version"] == 1
    rows = {row["name"]: row for row in document["instances"]}
    assert (rows["Chair"]["category"], rows["Chair"]["labelled"]) == ("chair", True)
    assert (rows["Rock"]["category"], rows["Rock"]["labelled"]) == (None, False)
    assert rows["Odd"]["reason"] == "outside_view"
    with np.load(tmp_path / "out" / "buffers.npz") as arrays:
        assert arrays["instance"].tolist() == small.view.buffers.instance.tolist()
        assert arrays["depth_z_m"].shape == (32, 64)
    photo = tmp_path / "out" / "overlay.png"
    write_inspection(small, tmp_path / "again", photo)
    with pytest.raises(LegoWorldError, match="64x32; expected: 64x64; next: pass --size 64x32"):
        write_inspection(looked_at(opened_again(tmp_path / "scene")), tmp_path / "x", photo)


def test_a_scene_that_changed_since_it_was_frozen(tmp_path):
    load(tmp_path / "scene")
    scene = SceneFolder(path=tmp_path / "scene", name="scene")
    write_frozen(scene, checked_artefacts(scene, require_frozen=False).artefacts, {}, {})
    assert opened_again(scene.path, require_frozen=True).warnings == ()
    (scene.path / "scene.glb").unlink()
    with pytest.raises(SceneChangedError, match="pass --allow-changed to inspect it as it is"):
        load(scene.path, SQUARES[:1])
    now = opened_again(scene.path, allow_changed=True)
    assert now.warnings == (
        "scene.glb is not the file that was frozen: readout refuses the scene until it is frozen "
        "again",
    )
    assert now.scene.files.frozen == "at_readout"
    assert looked_at(now).warnings[0] == now.warnings[0]
