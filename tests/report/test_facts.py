"""What a page lists of one scene: every fact, and none that the run does not have."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from legoworld.records.base import UNSET
from legoworld.records.run_file import CameraOfScene, ImageSource, ProjectionOfView
from legoworld.records.run_rows import InstanceCounts, RunRow, Unlabelled, Unmatched
from legoworld.report.facts import run_facts, run_tables

BARE = RunRow(image_id=1, file_name="a.jpg", status="ok")
POSE = ((1.0, 0.0, 0.0, 1.5), (0.0, 1.0, 0.0, -2.0), (0.0, 0.0, 1.0, 3.25))
CAMERA = CameraOfScene(
    name="Camera.001", type="PERSP", world_from_camera=POSE, lens_mm=35.5, sensor_width_mm=36,
    sensor_height_mm=24, sensor_fit="AUTO", shift_x=0.125, shift_y=-0.5, ortho_scale=6,
    clip_start=0.1, clip_end=1000,
)  # fmt: skip


def source(**given: Any) -> ImageSource:
    return ImageSource(**given)


def test_a_row_without_a_scene_has_its_verdict_alone() -> None:
    assert run_facts(BARE, None) == [("verdict", "ok")]
    assert run_facts(replace(BARE, code="ok"), None) == [("verdict", "ok")]
    invalid = replace(BARE, status="invalid", code="no_camera")
    assert run_facts(invalid, None) == [("verdict", "invalid"), ("code", "no_camera")]
    assert run_tables(BARE) == []


def test_objects_view_and_the_scene_s_own_picture() -> None:
    counts = InstanceCounts(total=9, labelled=5, visible_labelled=4, visible_unlabelled=3)
    row = replace(
        BARE, instances=counts, rendered_wh=(120, 50), geometry_px=1500,
        scene_size_wh=(640, 480), aspect_differs=True,
    )  # fmt: skip
    objects = ("objects", "9: 4 of 5 with a category are visible, 3 without one")
    assert run_facts(row, None)[1:] == [
        objects,
        ("view", "120x50, geometry in 25.0%"),
        ("the scene's own picture", "640x480 (another aspect than the photo)"),
    ]
    row = replace(row, geometry_px=UNSET, aspect_differs=False)
    assert run_facts(row, None)[1:] == [
        objects,
        ("view", "120x50"),
        ("the scene's own picture", "640x480"),
    ]


def test_the_camera_and_its_intrinsics() -> None:
    view = ProjectionOfView(
        orthographic=False, fx=100.125, fy=101, cx=60, cy=45.5, z_near=0.1, z_far=9
    )
    facts = dict(run_facts(BARE, source(camera=CAMERA, projection=view)))
    assert facts["camera"] == (
        "Camera.001: 35.5 mm on a 36 mm sensor, fit auto, shift 0.125, -0.5, clip 0.1 to 1000 m"
    )
    assert facts["camera at"] == "(1.500, -2.000, 3.250) m"
    assert facts["intrinsics, px"] == "fx 100.12, fy 101.00, cx 60.00, cy 45.50"
    flat = dict(run_facts(BARE, source(camera=replace(CAMERA, type="ORTHO"))))
    assert flat["camera"].startswith("Camera.001: orthographic, scale 6, fit auto")
    assert "intrinsics, px" not in flat
    assert "camera" not in dict(run_facts(BARE, source()))


def test_files_by_name_and_where_the_scene_comes_from() -> None:
    found = source(
        scene="scenes/a",
        frozen="unfrozen",
        files={"scene.glb": None, "scene.blend": "ab12"},
        provenance={"seed": 7, "agent": "program"},
    )
    assert run_facts(BARE, found)[1:] == [
        ("scene", "scenes/a"),
        ("frozen", "unfrozen"),
        ("scene.blend", "sha256 ab12"),
        ("scene.glb", "none"),
        ("provenance: agent", "program"),
        ("provenance: seed", "7"),
    ]
    for provenance, said in ((UNSET, []), ("not JSON", [("provenance", "not JSON")])):
        assert run_facts(BARE, source(provenance=provenance))[1:] == [
            ("scene", "None"),
            ("frozen", "None"),
            *said,
        ]


@pytest.mark.parametrize(("view", "share"), [((100, 50), "20.0%"), (None, "-")])
def test_shares_of_a_view_and_labels_without_a_near_name(view: Any, share: str) -> None:
    row = replace(
        BARE,
        unlabelled=(Unlabelled(name="wall", area_px=1000),),
        unmatched=(Unmatched(label="thing", count=2, nearest=()),),
        matched={"b": "two", "a": "one"},
        **({"rendered_wh": view} if view else {}),
    )
    tables = [table.rows for table in run_tables(row)]
    assert tables == [
        (("wall", "1000", share),),
        (("thing", "2", "-"),),
        (("a", "one"), ("b", "two")),
    ]
