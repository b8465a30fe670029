"""A file's own projection, fitted to any picture as Blender would."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from scene.gltf.documents import Document, boxes, read

from legoworld.errors import NoCameraError, NonFiniteGeometryError, UnsupportedCameraError
from legoworld.scene.gltf.cameras import picture_size_wh, scene_camera
from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.gltf.nodes import node_tree
from legoworld.scene.gltf.verdicts import UnreadableGltfError
from legoworld.visibility.camera import projection


def perspective(**lens):
    made = Document(camera=False)
    made.camera({"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1} | lens})
    made.quad("Quad", -1, -1, 2)
    return made


def focal_px(size_wh, **lens):
    snapshot = read(perspective(**lens).glb())
    seen = projection(snapshot.camera, snapshot.render, size_wh)
    assert seen.fx == seen.fy
    assert (seen.cx, seen.cy) == (size_wh[0] / 2, size_wh[1] / 2)
    return seen.fx


@pytest.mark.parametrize("yfov", [1e-5, 0.002, 0.2, 0.55, 1.0, 2.0, 3.141])
def test_a_picture_of_the_cameras_own_aspect_keeps_yfov(yfov):
    for width, height in ((640, 480), (480, 640), (512, 512)):
        fy = focal_px((width, height), yfov=yfov, aspectRatio=width / height)
        assert fy == pytest.approx(height / 2 / math.tan(yfov / 2), rel=1e-12)


def test_a_landscape_camera_keeps_its_horizontal_field_of_view():
    tangent = math.tan(0.5) * 16 / 9
    assert focal_px((640, 480), aspectRatio=16 / 9) == pytest.approx(320 / tangent, rel=1e-12)
    # Blender's AUTO rule: the same angle spans the longer side of a portrait picture.
    assert focal_px((480, 640), aspectRatio=16 / 9) == pytest.approx(320 / tangent, rel=1e-12)


def test_a_portrait_camera_keeps_its_vertical_field_of_view():
    tangent = math.tan(0.5)
    assert focal_px((480, 640), aspectRatio=9 / 16) == pytest.approx(320 / tangent, rel=1e-12)
    assert focal_px((640, 480), aspectRatio=9 / 16) == pytest.approx(320 / tangent, rel=1e-12)


def test_without_an_aspect_yfov_is_kept_in_any_picture():
    for size in ((640, 480), (480, 640), (100, 700)):
        assert focal_px(size) == pytest.approx(size[1] / 2 / math.tan(0.5), rel=1e-12)


def test_boxes_are_exact():
    # Half the picture's width at distance 1 is 0.5: fx = 64, so 2 units 10 away are 12.8 px wide.
    made = perspective(yfov=2 * math.atan(0.375), aspectRatio=4 / 3, zfar=100)
    assert boxes(made.glb(), (64, 48)) == [("Quad", 144, (26, 18, 38, 30))]


def test_orthographic_cameras_keep_their_larger_magnification():
    for x, y, size in ((16, 8, (64, 32)), (8, 16, (32, 64)), (16, 16, (64, 64))):
        made = Document(camera=False)
        lens = {"xmag": x, "ymag": y, "znear": 0, "zfar": 100}
        made.camera({"type": "orthographic", "orthographic": lens})
        made.quad("Quad", -1, -1, 2)
        (found,) = boxes(made.glb(), size)
        assert found[1] == 16  # 2 px a unit


@pytest.mark.parametrize("mag", [1e-6, 0.01, 1e6])
def test_the_smallest_and_largest_orthographic_views(mag):
    made = Document(camera=False)
    lens = {"xmag": mag, "ymag": mag / 2, "znear": 0, "zfar": 100}
    made.camera({"type": "orthographic", "orthographic": lens})
    made.quad("Quad", -1, -1, 2)
    assert read(made.glb()).camera.ortho_scale == 2 * mag
    for beyond in (1e-13, 0.99e-6, 1.01e6, 1e13):
        lens |= {"xmag": beyond, "ymag": beyond}
        with pytest.raises(UnsupportedCameraError, match="xmag"):
            read(made.glb())


def test_clip_planes_are_the_files():
    made = perspective(zfar=9.5)
    with_far = read(made.glb())
    assert (with_far.camera.clip_start, with_far.camera.clip_end) == (0.1, 9.5)
    assert boxes(with_far) == []
    del made.json["cameras"][0]["perspective"]["zfar"]
    assert len(boxes(made.glb())) == 1


def test_the_pose_is_blenders_without_scale():
    made = perspective(aspectRatio=1)
    made.json["nodes"][0] |= {"translation": [1, 2, 3], "scale": [2, 5, 0.5]}
    pose = read(made.glb()).camera.world_from_camera
    # Looking along glTF's -z, which is Blender's y; x right, y down, z forward.
    assert pose == ((1, 0, 0, 1), (0, 0, 1, -3), (0, -1, 0, 2))


@pytest.mark.parametrize(
    "lens",
    [
        {"yfov": 0}, {"yfov": -1}, {"yfov": 3.2}, {"znear": 0}, {"znear": 5, "zfar": 5},
        {"zfar": 1e31}, {"aspectRatio": 0}, {"aspectRatio": -1}, {"yfov": 1e-9},
        {"yfov": 3.1, "aspectRatio": 1e9},
    ],
)  # fmt: skip
def test_lenses_that_cannot_be(lens):
    with pytest.raises(UnsupportedCameraError):
        read(perspective(**lens).glb())


def test_other_broken_cameras():
    made = perspective()
    made.json["cameras"][0]["type"] = "fisheye"
    with pytest.raises(UnsupportedCameraError, match="fisheye"):
        read(made.glb())
    made = perspective()
    del made.json["cameras"][0]["perspective"]["yfov"]
    with pytest.raises(UnreadableGltfError, match=r"perspective\.yfov is nothing"):
        read(made.glb())
    made = perspective()
    made.json["nodes"][0]["scale"] = [1, 0, 1]
    with pytest.raises(NonFiniteGeometryError, match="'Camera' is broken"):
        read(made.glb())


def test_the_first_of_several_cameras_is_read_and_the_others_are_named():
    made = perspective(aspectRatio=1)
    made.camera({"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}, name="Second")
    snapshot = read(made.glb())
    assert snapshot.camera.name == "Camera"
    assert any("2 cameras" in w and "not 'Second'" in w for w in snapshot.warnings)


def test_the_picture_is_of_the_cameras_aspect():
    assert picture_size_wh(16 / 9) == (1920, 1080)
    assert picture_size_wh(3 / 4) == (1080, 1440)
    assert picture_size_wh(1) == (1080, 1080)
    assert picture_size_wh(16) == (8192, 512)
    snapshot = read(perspective(aspectRatio=4 / 3).glb())
    assert snapshot.render.size_wh == (1440, 1080)
    assert any("no picture size, only the aspect 1.33333" in w for w in snapshot.warnings)
    none = read(perspective().glb())
    assert none.render.size_wh == picture_size_wh(None) == (1920, 1080)
    assert any("no picture size, nor an aspect: 1920x1080" in w for w in none.warnings)
    extreme = read(perspective(yfov=0.5, aspectRatio=1e-5).glb())
    assert extreme.render.size_wh == (1920, 1080)
    narrowest = read(perspective(yfov=0.5, aspectRatio=1 / 8192).glb())
    assert narrowest.render.size_wh == (1, 8192)


def test_a_scene_without_a_camera_has_one_only_where_any_will_do():
    document = parse_glb(perspective(yfov=1.5).glb()).document
    tree = node_tree(document)
    found = [scene_camera(document, tree, any_camera=any_camera) for any_camera in (False, True)]
    assert found[0] == found[1]
    empty = replace(tree, nodes=tuple(node for node in tree.nodes if node.camera < 0))
    default, aspect, warnings = scene_camera(document, empty, any_camera=True)
    assert (default.lens_mm, aspect, warnings) == (50.0, None, ())
    with pytest.raises(NoCameraError):
        scene_camera(document, empty)


@pytest.mark.parametrize("flat", [{"xmag": 0}, {"ymag": 0}])
def test_an_orthographic_view_has_a_width_and_a_height(flat):
    lens = {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 100} | flat
    made = Document(camera=False)
    made.camera({"type": "orthographic", "orthographic": lens})
    made.quad("Quad", -1, -1, 2)
    with pytest.raises(UnsupportedCameraError, match="xmag"):
        read(made.glb())
