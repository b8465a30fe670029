"""A submission of the bench: V's checks, what its files hold, and which errors end it."""

from __future__ import annotations

import hashlib
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from scene.gltf.documents import Document
from scene.stand_in import FACTS, StandIn

from legoworld.cards import load_card
from legoworld.errors import (
    LegoWorldError,
    NoCameraError,
    NoMeshError,
    NonFiniteGeometryError,
    SceneInvalidError,
    UnsupportedCameraError,
    WorkerCrashedError,
)
from legoworld.readouts.family import protocol
from legoworld.records.run_rows import RunRow
from legoworld.records.submission import Check, Validity
from legoworld.running.image_record import ImageOptions
from legoworld.running.reconstruction_image import read_submission
from legoworld.running.shared_scene import SharedScene
from legoworld.running.submission import (
    OK,
    artefact_checks,
    bench_rules,
    blend_checks,
    card_size,
    failed_check,
    validity_counts,
)
from legoworld.scene.folder import SceneFolder
from legoworld.tracks.track import TrackImage

CARD = load_card("bench")
IMAGE = TrackImage(id=7, file_name="room.png", size_wh=(64, 32), scene="room", hfov_deg=60.0)


def png(*shades: int) -> bytes:
    picture = np.array(shades, np.uint8).repeat(3).reshape(1, -1, 3)
    return cv2.imencode(".png", picture)[1].tobytes()


def document(name="Chair") -> Document:
    made = Document(camera=False)
    lens = {"yfov": 1.0, "znear": 0.1, "zfar": 100, "aspectRatio": 2}
    made.camera({"type": "perspective", "perspective": lens})
    made.quad(name, -4, -4)
    return made


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "scenes" / "room"
    path.mkdir(parents=True)
    for name in ("scene.blend", "scene.glb"):
        (path / name).write_bytes(document().glb())
    (path / "final.png").write_bytes(png(0, 9))
    return SceneFolder(path=path, name="room")


def submit(folder, blender, *, render=False, noise=False, facts=True):
    rules = bench_rules(CARD, render=render, noise=noise, facts=facts)
    run = folder.path.parents[1] / "run"
    for name in ("surface", "render"):
        (run / name).mkdir(parents=True, exist_ok=True)
    options = ImageOptions(
        scenes=folder.path.parent, run=run, protocol=protocol("bench", None), source="blend",
        cache=None, require_frozen=False, max_side=None, threads=1, bench=rules,
    )  # fmt: skip
    with blender:
        scene = SharedScene(IMAGE.scene, options, blender)
        record = read_submission(IMAGE, scene, options, rules, blender)
    return record, run


def matches_entry(run: Path, entry) -> bool:
    data = (run / entry.file).read_bytes()
    return (entry.sha256, entry.bytes) == (hashlib.sha256(data).hexdigest(), len(data))


def test_a_whole_submission(folder):
    (folder.path / "provenance.json").write_text('{"agent": "a"}')
    record, run = submit(folder, StandIn(pictures=(png(1, 2),)), render=True)
    row = record.row
    assert (row.status, row.code, row.image_id, row.size_wh) == ("ok", "ok", 7, (64, 32))
    assert (row.valid, row.warnings, row.frozen) == (True, (), "at_readout")
    assert row.validity == Validity(
        scene_blend=OK, geometry=OK, camera=OK, scene_glb=OK, final_png=OK
    )
    assert row.camera.type == "PERSP"
    assert matches_entry(run, row.surface)
    assert matches_entry(run, row.render)
    assert row.surface.file == "surface/room.npz"
    assert row.surface.finite_px > 0
    with np.load(run / row.surface.file) as arrays:
        assert arrays["depth_z_m"].shape == row.surface.raster_wh[::-1]
        assert np.isfinite(arrays["depth_z_m"]).sum() == row.surface.finite_px
        assert arrays["textures"].shape == (1, 2, 2, 3)
    assert row.integrity.drivers == FACTS["drivers"]
    assert row.integrity.world_nodes == ("Background",)
    assert row.joints is msgspec.UNSET
    assert (run / row.render.file).read_bytes() == png(1, 2)
    assert (row.render.noise, row.render.size_wh) == (None, card_size((64, 32), 512))
    assert record.scene.provenance == {"agent": "a"}
    assert record.scene.files["scene.blend"] == record.scene.files["scene.glb"]
    assert row.snapshot_sha256 == record.scene.snapshot_sha256


def test_what_is_not_asked_for_is_not_made(folder):
    blender = StandIn()
    row = submit(folder, blender, facts=False)[0].row
    assert [m["kind"] for m in blender.asked] == ["snapshot"]
    assert row.status == "ok"
    assert {row.render, row.integrity, row.joints} == {msgspec.UNSET}
    blender = StandIn(pictures=(png(1, 2),))
    submit(folder, blender, render=True)
    assert [m["kind"] for m in blender.asked] == ["snapshot", "facts", "card_render"]
    asked = blender.asked[-1]["card"]
    assert (asked["denoise"], asked["threads"], asked["seed"]) == (False, 1, 0)
    assert asked["samples"] == CARD.value("render.samples")


def test_a_flat_mesh_before_the_camera_is_a_plane(folder):
    facts = {**FACTS, "images_of": {"Chair": ["photo.png"]}}
    row = submit(folder, StandIn(facts=facts))[0].row
    (plane,) = row.integrity.planes
    assert (plane.object, plane.images) == ("Chair", ("photo.png",))
    assert plane.tilt_deg == pytest.approx(0.0, abs=1e-4)
    assert 0 < plane.share < 1


def test_an_image_that_was_not_delivered_is_told_of(folder):
    image = {"name": "Wood", "path": "//wood.png", "size_wh": [0, 0], "packed": False,
             "generated": False, "absolute_path": False, "thumbnail": None,
             "users": ["material"]}  # fmt: skip
    others = [
        {"name": "Far", "path": "/far/oak.png", "absolute_path": True},
        {"name": "Unused", "users": []},
        {"name": "Made", "generated": True},
        {"name": "Read", "size_wh": [4, 0]},
    ]
    facts = {**FACTS, "images": [image, *({**image, **other} for other in others)]}
    row = submit(folder, StandIn(facts=facts))[0].row
    assert row.warnings == (
        "image 'Wood' cannot be read and renders magenta: //wood.png; pack it into scene.blend",
        "image 'Far' cannot be read and renders magenta: /far/oak.png, an absolute path; pack it "
        "into scene.blend",
    )
    assert len(row.integrity.images) == 5


def test_the_noise_of_a_render_is_that_of_two_seeds(folder):
    delta = CARD.value("scoring.delta")
    pictures = (png(10, 10, 10, 10), png(10, 10 + delta, 11 + delta, 10))
    blender = StandIn(pictures=pictures)
    row = submit(folder, blender, render=True, noise=True)[0].row
    assert [m["card"]["seed"] for m in blender.asked if "card" in m] == [0, 1]
    noise = row.render.noise
    assert noise.seeds == (0, 1)
    assert noise.share_over_delta == 0.25
    assert noise.mean_largest_difference == (2 * delta + 1) / 4
    assert bench_rules(CARD, render=False, noise=True).noise is False


@pytest.mark.parametrize(
    ("longest", "size_wh", "expected"),
    [(512, (64, 32), (512, 256)), (100, (300, 200), (100, 67)), (100, (200, 300), (67, 100)),
     (10, (1000, 1), (10, 1))],
)  # fmt: skip
def test_the_longer_side_of_a_render_is_the_cards(longest, size_wh, expected):
    assert card_size(size_wh, longest) == expected


def test_a_process_that_is_lost_is_asked_once_more(folder):
    assert submit(folder, StandIn(lost=1))[0].row.status == "ok"
    row = submit(folder, StandIn(lost=2))[0].row
    assert (row.status, row.valid) == (WorkerCrashedError("").status, False)
    assert row.validity.scene_blend.ok is False
    assert row.validity.scene_glb.ok is True


def test_a_scene_without_a_camera_fails_that_check_alone(folder):
    made = Document(camera=False)
    made.quad("Chair", 0, 0)
    (folder.path / "scene.blend").write_bytes(made.glb())
    row = submit(folder, StandIn())[0].row
    assert (row.status, row.code, row.valid) == ("invalid", "no_camera", False)
    assert [name for name in Validity.__struct_fields__ if not getattr(row.validity, name).ok] == [
        "camera"
    ]


@pytest.mark.parametrize(
    ("error", "failed"),
    [
        (NoMeshError, ["geometry"]), (NonFiniteGeometryError, ["geometry"]),
        (NoCameraError, ["camera"]), (UnsupportedCameraError, ["camera"]),
        (SceneInvalidError, ["scene_blend", "geometry", "camera"]), (None, []),
    ],
)  # fmt: skip
def test_which_check_an_error_of_reading_fails(error, failed):
    checks = blend_checks(error("what", found="found") if error else None)
    assert [name for name, check in checks.items() if not check.ok] == failed
    if len(failed) == 3:
        assert checks["camera"] == Check(
            ok=False, found="scene.blend was not read", expected="a scene.blend to read"
        )


def test_an_error_is_a_check_with_its_words():
    whole = LegoWorldError("what", found="found", expected="expected", next_step="next")
    assert failed_check(whole) == Check(
        ok=False, found="what: found", expected="expected", next_step="next"
    )
    assert failed_check(LegoWorldError("what")) == Check(ok=False, found="what")


def test_artefacts_that_are_missing_or_show_nothing_are_warned_of(folder):
    (folder.path / "final.png").write_bytes(png(5, 5))
    (folder.path / "scene.glb").unlink()
    checks = artefact_checks(folder)
    assert checks["scene_glb"].next_step == "deliver scene.glb beside scene.blend"
    assert checks["scene_glb"].found == "the scene folder holds no scene.glb: no such file"
    row = submit(folder, StandIn())[0].row
    assert (row.status, row.valid) == ("ok", False)
    assert row.warnings == (
        f"not valid: scene.glb: {checks['scene_glb'].found}",
        f"not valid: final.png: {checks['final_png'].found}",
    )


def test_a_glb_of_another_scene_is_warned_of(folder):
    (folder.path / "scene.glb").write_bytes(document("Table").glb())
    row = submit(folder, StandIn())[0].row
    assert (row.valid, len(row.warnings)) == (True, 1)
    assert row.warnings[0].startswith("scene.glb has none of the 2 object names of scene.blend on")
    assert "its 1 meshes" in row.warnings[0]


def test_a_camera_that_sees_nothing_and_one_without_perspective_are_warned_of(folder):
    made = Document()
    made.quad("Chair", 500, 500)
    (folder.path / "scene.blend").write_bytes(made.glb())
    row = submit(folder, StandIn())[0].row
    assert row.warnings == (
        "the camera is orthographic: R takes its pose and not its projection",
        "the camera sees nothing: every pixel is without geometry",
    )
    assert (row.surface.finite_px, row.camera.hfov_deg) == (0, None)


def test_a_side_file_that_cannot_be_used_keeps_what_was_made(folder):
    (folder.path / "provenance.json").write_text("[]")
    record, _ = submit(folder, StandIn(), facts=False)
    assert (record.row.status, record.row.code) == ("invalid", "invalid_side_file")
    assert record.row.valid is True
    assert record.row.surface.finite_px > 0
    assert record.scene is None


def test_how_many_are_valid_and_fail_each_check():
    bad = Check(ok=False)
    whole = Validity(scene_blend=OK, geometry=OK, camera=OK, scene_glb=OK, final_png=OK)
    row = RunRow(image_id=1, file_name="a", scene="a", size_wh=None, status="ok", code="ok")
    rows = [
        msgspec.structs.replace(row, valid=True, validity=whole),
        msgspec.structs.replace(
            row, valid=False, validity=msgspec.structs.replace(whole, scene_glb=bad, camera=bad)
        ),
        msgspec.structs.replace(
            row, valid=False, validity=msgspec.structs.replace(whole, scene_glb=bad)
        ),
        row,
    ]
    counts = validity_counts(rows)
    assert counts.valid == 1
    assert counts.failed == {
        "scene_blend": 0, "geometry": 0, "camera": 1, "scene_glb": 2, "final_png": 0,
    }  # fmt: skip
