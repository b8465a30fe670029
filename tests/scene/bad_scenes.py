"""Scenes that no readout can use, and the good one that others are made from."""

from __future__ import annotations

from pathlib import Path

import bpy
from cases.stage import box, camera, collection, empty, fresh, instance_of, pixel_camera, square


def good() -> None:
    pixel_camera()
    box("Chair", 10, 10, 30, 30, category="chair")


def no_camera() -> None:
    square("Chair")


def cameras_none_active() -> None:
    camera((0, 0, 5))
    camera((0, 0, 6))
    square("Chair")
    bpy.context.scene.camera = None


def camera_is_an_empty() -> None:
    square("Chair")
    bpy.context.scene.camera = empty("Eye")


def panoramic() -> None:
    camera((0, 0, 5), type="PANO")
    square("Chair")


def flat_camera() -> None:
    camera((0, 0, 5)).scale = (0, 1, 1)
    square("Chair")


def reversed_clip() -> None:
    camera((0, 0, 5), clip_start=10.0, clip_end=1.0)
    square("Chair")


def infinite_camera() -> None:
    camera((0, 0, 5)).location.x = float("inf")
    square("Chair")


def no_mesh() -> None:
    camera((0, 0, 5))
    empty("Chair", category="chair")


def only_hidden_meshes() -> None:
    camera((0, 0, 5))
    square("Chair", category="chair").hide_render = True
    group = collection("Excluded")
    square("Table", 1, group)
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True


def only_loose_edges() -> None:
    camera((0, 0, 5))
    mesh = bpy.data.meshes.new("Wire")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Wire", mesh))


def broken_vertices() -> None:
    camera((0, 0, 5))
    points = square("Chair").data.vertices
    points[0].co.x = float("nan")
    points[1].co.y = float("inf")


def infinite_matrix() -> None:
    camera((0, 0, 5))
    square("Table")
    square("Chair").location.x = float("inf")


def far_away() -> None:
    camera((0, 0, 5))
    square("Chair").scale = (1e20, 1, 1)


def hidden_and_broken() -> None:
    """What is not drawn may be broken."""
    pixel_camera()
    box("Chair", 10, 10, 30, 30, category="chair")
    square("Broken").location.x = float("nan")
    bpy.data.objects["Broken"].hide_render = True


def odd_labels() -> None:
    pixel_camera()
    for i, label in enumerate((["chair"], {"is": "chair"}, b"chair", 3, True)):
        made = box(f"Thing {i}", 10 * i, 0, 10 * i + 8, 8)
        made["category"] = label
    bpy.data.objects["Thing 0"]["coco_category"] = bpy.data.objects["Thing 1"]


def linking() -> None:
    """Links a chair from a library beside it, whose own bolts come from a nested one."""
    square("Seat", 20, collection("Chair", category="chair"))
    _save("larger.blend")  # not linked: may take the place of outer.blend
    fresh()
    bolts = collection("Bolts")
    square("Bolt", 2, bolts)
    _save("inner.blend")
    fresh()
    chair = collection("Chair", category="chair")
    square("Seat", 10, chair)
    instance_of(_linked("inner.blend", "Bolts"), "Bolts here", 40, 30, chair)
    _save("outer.blend")
    fresh()
    pixel_camera()
    instance_of(_linked("outer.blend", "Chair"), "Chair here", 40, 30)


def _save(name: str) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(Path.cwd() / "linking" / name), check_existing=False)


def _linked(name: str, group: str) -> bpy.types.Collection:
    path = str(Path.cwd() / "linking" / name)
    with bpy.data.libraries.load(path, link=True, relative=False) as (_, wanted):
        wanted.collections = [group]
    for library in bpy.data.libraries:
        library.filepath = f"//{Path(library.filepath).name}"
    return wanted.collections[0]
