"""Cameras, picture sizes, units and frames."""

from __future__ import annotations

from collections.abc import Callable
from math import radians
from typing import Any

import bpy
from agreement.traps.stage import Expect, camera, collection, floor, link, solid, wall

Trap = Callable[[], Expect]


def _things() -> Expect:
    """A scene without symmetry, so that a mirrored or shifted picture cannot pass."""
    floor()
    wall()
    solid("cube", "cube", (-2, 0, 1), turn=(0, 0, 30))
    solid("uv_sphere", "ball", (1, 1, 1.4), scale=(1.4, 1, 1.4))
    solid("cone", "cone", (0.3, -2, 0.7), scale=(0.7, 0.7, 0.7))
    solid("monkey", "monkey", (2.6, -1, 0.9))
    solid("torus", "behind", (0.5, -14, 6), turn=(30, 20, 0))
    return Expect(seen=("cube", "ball", "cone", "monkey", "Floor", "Wall"))


def _picture(
    width: int, height: int, aspect: tuple[float, float] = (1, 1), percent: int = 100
) -> None:
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = width, height
    render.pixel_aspect_x, render.pixel_aspect_y = aspect
    render.resolution_percentage = percent


def _case(
    name: str,
    doc: str,
    picture: tuple[Any, ...] = (320, 240),
    scale: tuple[float, float, float] = (1, 1, 1),
    seen: tuple[str, ...] | None = None,
    **lens: Any,
) -> Trap:
    def build() -> Expect:
        expected = _things()
        _picture(*picture)
        camera(**{"lens": 30.0, **lens}).scale = scale
        return expected if seen is None else Expect(seen=seen)

    build.__name__, build.__doc__ = name, doc
    return build


def camera_parented() -> Expect:
    """A camera below a scaled, turned and sheared chain of empties."""
    expected = _things()
    base = link(bpy.data.objects.new("base", None))
    base.scale, base.rotation_euler = (2, 0.5, 1.5), (0, 0, radians(15))
    arm = link(bpy.data.objects.new("arm", None))
    arm.parent, arm.rotation_euler = base, (0, radians(12), radians(20))
    eye = camera((0.5, -9, 3), lens=30)
    eye.parent = arm
    return expected


def camera_tracked() -> Expect:
    """A camera aimed by a Track To constraint."""
    expected = _things()
    eye = camera((4, -9, 5), (0, 0, 20), lens=30)
    aim = eye.constraints.new("TRACK_TO")
    aim.target, aim.track_axis, aim.up_axis = bpy.data.objects["cube"], "TRACK_NEGATIVE_Z", "UP_Y"
    return expected


def clip_planes() -> Expect:
    """Both clip planes cut through solids; what lies behind a cut is seen."""
    wall(30, "Beyond")
    solid("cube", "near", (-1.5, 0, 1), scale=(1, 3, 1))
    solid("uv_sphere", "inside", (-1.5, 0.5, 1), scale=(0.6, 0.6, 0.6))
    solid("cube", "far", (2, 2, 1), scale=(1, 5, 1), turn=(20, 0, 20))
    camera((0, -8, 2), (0, 0, 1), clip_start=7.5, clip_end=11.0)
    return Expect(seen=("near", "inside", "far"), unseen=("Beyond",))


def near_plane_room() -> Expect:
    """A room whose walls and floor run through the camera."""
    solid("cube", "room", (0, 0, 2), scale=(6, 9, 2))
    solid("plane", "table", (0.5, -6, 1.2), size=3.0)
    solid("cylinder", "pillar", (-1.4, -5, 2), scale=(0.3, 0.3, 2))
    camera((0, -7, 1.7), (0.4, 0, 1.4), lens=18, clip_start=0.1)
    return Expect(seen=("room", "table", "pillar"))


def inside_sphere() -> Expect:
    """The camera at the centre of a sphere: every ray meets a back face."""
    solid("uv_sphere", "sphere", segments=64, ring_count=32, radius=10)
    solid("cube", "cube", (1, 4, 0), scale=(0.5, 0.5, 0.5))
    camera((0, 0, 0), (0, 1, 0.2), lens=18)
    return Expect(seen=("sphere", "cube"))


def unit_scale() -> Expect:
    """A scene in centimetres."""
    expected = _things()
    bpy.context.scene.unit_settings.scale_length = 0.01
    camera(lens=30)
    return expected


def frame_and_marker() -> Expect:
    """A saved frame other than 1, an object moving through it, and a camera bound by a marker."""
    expected = _things()
    scene = bpy.context.scene
    moving = solid("torus", "moving", (-6, -2, 1))
    for frame, x in ((1, -6.0), (40, 5.0)):
        moving.location.x = x
        moving.keyframe_insert("location", frame=frame)
    first = camera((9, -9, 4), name="first", lens=30)
    second = camera((-3, -9, 5), name="second", lens=35)
    second.data.keyframe_insert("lens", frame=1)
    second.data.lens = 24
    second.data.keyframe_insert("lens", frame=40)
    for name, frame, bound in (("a", 1, first), ("b", 10, second), ("c", 35, first)):
        scene.timeline_markers.new(name, frame=frame).camera = bound
    scene.camera = first
    scene.frame_set(27)
    return Expect(seen=(*expected.seen, "moving"))


def marker_not_applied() -> Expect:
    """The active camera is not the one its marker asks for: a render switches to the marker's."""
    expected = _things()
    scene = bpy.context.scene
    bound = camera((-4, -9, 5), name="bound", lens=24)
    scene.timeline_markers.new("m", frame=1).camera = bound
    camera((7, -9, 4), name="active", lens=30)
    return expected


def late_marker() -> Expect:
    """The only marker with a camera lies after the saved frame."""
    expected = _things()
    scene = bpy.context.scene
    bound = camera((-4, -9, 5), name="bound", lens=24)
    scene.timeline_markers.new("m", frame=50).camera = bound
    camera((7, -9, 4), name="active", lens=30)
    scene.frame_set(20)
    return expected


def hidden_camera() -> Expect:
    """The camera object is hidden and lies in an excluded collection."""
    expected = _things()
    eye = camera(lens=30)
    eye.hide_render = True
    folder = collection("cameras")
    bpy.context.scene.collection.objects.unlink(eye)
    link(eye, folder)
    bpy.context.view_layer.layer_collection.children["cameras"].exclude = True
    return expected


_ORTHO: dict[str, Any] = {"type": "ORTHO", "ortho_scale": 9.0}

TRAPS = (
    _case("camera_scale_small", "A camera object scaled to a tenth.", scale=(0.1, 0.1, 0.1)),
    _case("camera_scale_large", "A camera object scaled up.", scale=(7, 7, 7)),
    _case("camera_scale_uneven", "A camera object with three scales.", scale=(0.3, 2, 5)),
    _case("camera_scale_mirrored", "A camera object with a negative x scale.", scale=(-1, 1, 1)),
    _case("camera_scale_backward", "One with a negative z scale: it looks back.", scale=(1, 1, -2),
          seen=("behind",)),
    _case("fit_auto_portrait", "The sensor spans the longer, vertical side.", (240, 320)),
    _case("fit_vertical", "Sensor fit VERTICAL.", sensor_fit="VERTICAL", sensor_height=20),
    _case("fit_vertical_portrait", "VERTICAL in portrait.", (200, 320), sensor_fit="VERTICAL"),
    _case("fit_horizontal_portrait", "The same.", (200, 320), sensor_fit="HORIZONTAL"),
    _case("shifted", "Lens shift in both directions.", shift_x=0.17, shift_y=-0.11),
    _case("shifted_portrait", "Lens shift in portrait.", (240, 320), shift_x=-0.1, shift_y=0.12),
    _case("aspect_2_1", "Pixels twice as wide as high.", (320, 240, (2, 1)), shift_y=0.1),
    _case("aspect_1_2", "Pixels twice as high as wide.", (320, 240, (1, 2)), shift_y=0.1),
    _case("aspect_10_11", "DV pixels, in portrait.", (240, 300, (10, 11)), shift_x=0.05),
    _case("percentage", "Half of an odd size.", (643, 481, (1, 1), 50)),
    _case("orthographic", "An orthographic camera.", **_ORTHO),
    _case("orthographic_portrait", "Shifted, in portrait.", (200, 320, (1, 1.5)), shift_x=0.1,
          **_ORTHO),
    _case("orthographic_clipped", "Clip planes of an orthographic camera.", clip_start=8,
          clip_end=12.5, at=(0.0, -9.0, 3.0), seen=("cube", "ball", "monkey", "Floor"), **_ORTHO),
    camera_parented,
    camera_tracked,
    clip_planes,
    near_plane_room,
    inside_sphere,
    unit_scale,
    frame_and_marker,
    marker_not_applied,
    late_marker,
    hidden_camera,
)  # fmt: skip
