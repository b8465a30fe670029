"""What a result says would mend it, applied to the scene and measured again."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from plugin.synthetic import evidence_with, region_of

from legoworld.plugin.entities import Entities
from legoworld.plugin.measure import measure, surface_view
from legoworld.records import plugin_requirements as kinds

pytestmark = pytest.mark.blender

SIZE = (320, 240)
MATCHED = (("Table", "Table"), ("Chair", "Chair"), ("Floor", "Floor"), ("Crate", "Crate"))


@pytest.fixture(scope="module")
def room(live: Any) -> Any:
    """The room with evidence of its own masks and depth."""
    scene = live("none")
    buffers = surface_view(scene, SIZE)
    entities = Entities(scene.snapshot)
    regions = [
        region_of(name, np.append(entities.surfaces(name), False)[buffers.instance])
        for name in ("Cup", "Table", "Chair", "Floor", "Crate")
    ]
    disparity = 1 / buffers.depth_z_m.astype(float)
    return scene, evidence_with(regions, disparity=disparity, size=SIZE)


def change(scene: Any, name: str, move: Any = (0, 0, 0), scale: float = 1.0) -> Any:
    """The scene with one entity scaled about its middle, then moved; metres."""
    shot = scene.snapshot
    points = Entities(shot).points_m(name)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    placed = shot.world_from_mesh.copy()
    some = Entities(shot).surfaces(name)
    placed[some] *= scale
    placed[some, :, 3] += middle * (1 - scale) + np.asarray(move)
    return dataclasses.replace(scene, reading=dataclasses.replace(shot, world_from_mesh=placed))


def ask(scene: Any, evidence: Any, requirement: Any) -> Any:
    (result,) = measure(scene, [requirement], evidence).results
    return result


@pytest.mark.parametrize("move", [(0.15, 0, 0), (0, 0.2, 0), (-0.1, -0.1, 0)])
def test_a_move_on_the_ground_takes_a_shifted_object_home(room: Any, move: Any) -> None:
    scene, evidence = room
    asked = kinds.Centroid(entity="Crate", region="Crate")
    off = change(scene, "Crate", move)
    fix = ask(off, evidence, asked).correction
    left = np.add(move, fix.on_ground_m)
    assert fix.on_ground_m[2] == 0
    assert np.linalg.norm(left) < 0.2 * np.linalg.norm(move)
    again = ask(change(off, "Crate", fix.on_ground_m), evidence, asked)
    assert again.residual < 0.2 * ask(off, evidence, asked).residual


def test_a_move_in_the_picture_s_plane_takes_the_centroid_there(room: Any) -> None:
    scene, evidence = room
    asked = kinds.Centroid(entity="Crate", region="Crate")
    off = change(scene, "Crate", (0.1, 0, 0.1))
    fix = ask(off, evidence, asked).correction
    again = ask(change(off, "Crate", fix.move_m), evidence, asked)
    assert again.residual < 0.2 * ask(off, evidence, asked).residual


@pytest.mark.parametrize("scale", [0.8, 1.25])
def test_a_scale_takes_the_extent_there(room: Any, scale: float) -> None:
    scene, evidence = room
    asked = kinds.Extent(entity="Crate", region="Crate")
    fix = ask(change(scene, "Crate", scale=scale), evidence, asked).correction
    assert fix.scale * scale == pytest.approx(1, abs=0.06)
    assert fix.move_m is None


def test_a_move_along_the_view_takes_the_depth_there(room: Any) -> None:
    scene, evidence = room
    asked = kinds.Depth(entity="Crate", matched=MATCHED)
    pose = np.array(scene.snapshot.camera.world_from_camera)
    points = Entities(scene.snapshot).points_m("Crate")
    way = (points.min(axis=0) + points.max(axis=0)) / 2 - pose[:, 3]
    off = change(scene, "Crate", 0.1 * way)
    before = ask(off, evidence, asked)
    fix = before.correction
    cosine = np.dot(fix.move_m, -way) / np.linalg.norm(fix.move_m) / np.linalg.norm(way)
    assert cosine == pytest.approx(1)
    assert ask(change(off, "Crate", fix.move_m), evidence, asked).residual < before.residual


def test_support_and_facing_say_how_far_and_nothing_is_said_of_what_passes_whole(room: Any) -> None:
    scene, evidence = room
    up = change(scene, "Cup", (0, 0, 0.25))
    fix = ask(up, evidence, kinds.Support(entity="Cup")).correction
    assert fix.move_m == pytest.approx((0, 0, -0.25), abs=1e-6)
    facing = kinds.Facing(entity="Chair", towards="Table")
    turned = ask(scene, evidence, facing)
    assert abs(turned.correction.yaw_deg) == pytest.approx(turned.measurement)
    assert ask(scene, evidence, kinds.Overlap(entity="Cup", region="Cup")).correction is None


def test_what_the_picture_s_edge_cuts_off_has_no_correction(room: Any) -> None:
    scene, evidence = room
    off = change(scene, "Floor", (0.3, 0, 0))
    result = ask(off, evidence, kinds.Overlap(entity="Floor", region="Floor"))
    assert result.residual > 0
    assert result.correction is None
