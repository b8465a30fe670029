"""Looks at the live scene: viewpoints, the photo beside it, and before and after an edit."""

from __future__ import annotations

import dataclasses
import json

import anyio
import cv2
import numpy as np
import pytest
from mcp import Client
from plugin.synthetic import evidence_with

from legoworld.errors import UsageError
from legoworld.plugin.open_ledger import TransactionError
from legoworld.plugin.server import plugin_server
from legoworld.plugin.server_looks import Looking, difference, draw_geometry, look
from legoworld.plugin.viewpoints import Viewpoint, find_camera
from legoworld.records.plugin_ledger import Declaration
from legoworld.visibility.camera import projection

pytestmark = pytest.mark.blender

WH = (64, 48)
PHOTO = np.full((120, 160, 3), 90, np.uint8)


def decode_png(png):
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]


def seen_at(snapshot, camera, point):
    """Where a camera shows a point of the world, as shares of the picture, and how far it is."""
    pose = np.array(camera.world_from_camera)
    x, y, z = pose[:, :3].T @ (np.array(point) - pose[:, 3])
    through = projection(camera, snapshot.render, WH)
    return (through.cx + through.fx * x / z) / 64, (through.cy + through.fy * y / z) / 48, z


@pytest.mark.parametrize(("azimuth_deg", "elevation_deg"), [(0, 30), (90, 10), (-90, 10), (0, 90)])
def test_an_orbit_is_turned_to_its_object_and_filled_by_it(live, azimuth_deg, elevation_deg):
    shot = live("none").snapshot
    at = Viewpoint(around="Table", azimuth_deg=azimuth_deg, elevation_deg=elevation_deg)
    camera = find_camera(shot, at)
    u, v, _ = seen_at(shot, camera, (0, 0, 0.375))
    assert (u, v) == pytest.approx((0.5, 0.5))
    corners = [(x, y, s) for x in (-1, 1) for y in (-0.5, 0.5) for s in (0, 0.75)]
    shown = np.array([seen_at(shot, camera, c)[:2] for c in corners])
    assert shown.min() > 0
    assert shown.max() < 1
    nearest = min(seen_at(shot, camera, c)[2] for c in corners)
    assert nearest / 2 < camera.clip_start <= nearest, "no depth is lost on what is in front"
    pose = np.array(camera.world_from_camera)
    assert np.linalg.det(pose[:, :3]) == pytest.approx(1)
    assert pose[2, 1] <= 1e-9  # upright: the picture's down is not up
    height = np.degrees(
        np.arcsin((pose[2, 3] - 0.375) / np.linalg.norm(pose[:, 3] - (0, 0, 0.375)))
    )
    assert height == pytest.approx(elevation_deg)
    # The active camera stands at -y and looks along +y: its right is +x.
    sides = {0: (0, -1), 90: (1, 0), -90: (-1, 0)}
    if elevation_deg < 90:
        flat = pose[:2, 3] / np.linalg.norm(pose[:2, 3])
        assert flat == pytest.approx(sides[azimuth_deg], abs=1e-6)


def test_cameras_by_name_by_points_and_none(live):
    shot = live("none").snapshot
    assert find_camera(shot, Viewpoint()) == shot.camera
    assert find_camera(shot, Viewpoint(camera=shot.camera.name)) == shot.camera
    between = find_camera(shot, Viewpoint(from_m=(0, 0, 5), to_m=(0, 0, 0)))
    u, v, z = seen_at(shot, between, (0, 1, 0))
    assert u == pytest.approx(0.5)
    assert v < 0.5  # from above, ahead of the active camera is up
    assert z == pytest.approx(5)


@pytest.mark.parametrize(
    ("at", "why"),
    [
        (Viewpoint(camera="Nobody"), "no such viewpoint.*Nobody.*Camera"),
        (Viewpoint(around="Tabel"), "Table"),
        (Viewpoint(around="Table", camera="Camera"), "half of one"),
        (Viewpoint(from_m=(0, 0, 1)), "half of one"),
        (Viewpoint(from_m=(0, 0, 1), to_m=(0, 0, 1)), "one point"),
    ],
)
def test_what_is_no_viewpoint_is_refused(live, at, why):
    with pytest.raises(UsageError, match=why):
        find_camera(live("none").snapshot, at)


def test_the_geometry_is_drawn_alike_whatever_else_there_is(live):
    before, after = (draw_geometry(live(name).snapshot, WH) for name in ("none", "moved"))
    apart = np.argwhere((before != after).any(axis=2))
    assert 0 < len(apart) < 600  # where the cup was and is, and nowhere else
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 5


def test_a_difference_says_which_is_brighter():
    first = np.full((1, 3, 3), 100, np.uint8)
    second = first + np.array([[[0], [50], [0]]], np.uint8)
    second[0, 2] = 20
    assert difference(first, second).tolist() == [
        [[255, 255, 255], [255, 205, 205], [175, 175, 255]]
    ]


def test_a_look_before_and_after_an_edit(case, blender_code):
    at = Viewpoint(around="Table", elevation_deg=60.0)
    with pytest.raises(TransactionError, match="no transaction"):
        look(case, Looking(at=at, beside="before", draw="geometry", pane_px=64))
    case.begin(Declaration(editable=("Cup",), kinds=("transform",)))
    made, png = look(case, Looking(at=at, beside="before", draw="geometry", pane_px=64))
    assert (made.panes, made.size_wh) == (("before", "scene", "difference"), (64, 48))
    picture = decode_png(png)
    assert picture.shape == (48, 192, 3)
    assert (picture[:, 128:] == 255).all()
    assert (picture[:, :64] == picture[:, 64:128]).all()
    blender_code.run("import bpy; bpy.data.objects['Cup'].location.x += 0.5")
    edited = decode_png(look(case, Looking(at=at, beside="before", draw="geometry", pane_px=64))[1])
    assert (edited[:, :64] == picture[:, :64]).all()
    changed = (edited[:, 128:] != 255).any(axis=2)
    assert 0 < changed.sum() < changed.size / 4
    last = case.ledger.entries[-1]
    assert (last.tool, last.request["at"]["around"]) == ("look", "Table")
    assert last.answer["picture_sha256"] != made.picture_sha256
    # Looking was no edit, and the copy that a rollback returns to is whole.
    case.rollback()


def test_a_render_from_the_side_beside_none_and_the_photo(case, blender_code):
    lit = "lamp = bpy.data.objects['Lamp']; lamp.location, lamp.data.energy = (0, -2, 3), 500"
    blender_code.run(f"import bpy; {lit}")
    own = decode_png(
        look(case, Looking(at=Viewpoint(), beside="nothing", draw="render", pane_px=64))[1]
    )
    aside = Viewpoint(around="Chair", azimuth_deg=45.0)
    side = decode_png(look(case, Looking(at=aside, beside="nothing", draw="render", pane_px=64))[1])
    assert own.shape == side.shape == (48, 64, 3)
    assert np.abs(own.astype(int) - side).max() > 30
    with pytest.raises(UsageError, match="no photo"):
        look(case, Looking(at=Viewpoint(), beside="photo", draw="render", pane_px=64))
    case.evidence = dataclasses.replace(evidence_with([], photo=PHOTO, size=(160, 120)))
    with pytest.raises(UsageError, match="another camera"):
        look(case, Looking(at=aside, beside="photo", draw="render", pane_px=64))
    made, png = look(case, Looking(at=Viewpoint(), beside="photo", draw="render", pane_px=64))
    assert made.panes == ("photo", "scene", "difference")
    picture = decode_png(png)
    assert (picture[:, :64] == 90).all()
    assert (picture[:, 64:128] == own).all()
    assert (picture[:, 128:] == difference(picture[:, :64], own)).all()


def test_the_tool_answers_with_a_small_picture(case):
    async def talk():
        async with Client(plugin_server(case, None)) as client:
            return await client.call_tool(
                "look", {"at": {"around": "Cup", "azimuth_deg": 90}, "draw": "geometry"}
            )

    answer = anyio.run(talk)
    assert not answer.is_error, answer.content
    said, picture = answer.content
    about = json.loads(said.text)
    assert about["size_wh"] == [256, 192]
    assert about["scene_signature"] == case.ledger.entries[-1].scene_signature
    assert picture.mime_type == "image/png"
