"""The files that are damaged: one scene with a little of everything, saved in several ways."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Final

#: For the `build_scenes` fixture: the same scene uncompressed, and compressed with Zstandard.
PROGRAM: Final = """
import numpy as np

def varied():
    scene = fresh(); camera()
    quad("Wall", z=-3, half=12, category="bed")
    dog = quad("Dog", x=-2, category="dog")
    dog.modifiers.new("Array", "ARRAY").count = 3
    cat = quad("Cat", x=2, y=1, category="cat")
    cat.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    cat.shape_key_add(name="Basis"); cat.shape_key_add(name="Up").value = 0.5
    paw = quad("Paw", x=2, y=-1, half=0.3); paw.parent = cat
    material = bpy.data.materials.new("Leaf"); material.use_nodes = True
    image = bpy.data.images.new("Alpha", 8, 8, alpha=True)
    image.pixels.foreach_set(np.tile(np.float32([1, 1, 1, 0.7]), 64)); image.pack()
    texture = material.node_tree.nodes.new("ShaderNodeTexImage"); texture.image = image
    shader = material.node_tree.nodes["Principled BSDF"]
    material.node_tree.links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])
    leaf = quad("Leaf", y=2); leaf.data.uv_layers.new(); leaf.data.materials.append(material)
    group = bpy.data.collections.new("Set"); group["category"] = "chair"
    seat = quad("Seat", half=0.4); scene.collection.objects.unlink(seat); group.objects.link(seat)
    for i in range(3):
        empty = bpy.data.objects.new(f"Place{i}", None)
        empty.instance_type = "COLLECTION"; empty.instance_collection = group
        empty.location = (i - 1, -2.5, 1); scene.collection.objects.link(empty)
    curve = bpy.data.curves.new("Ring", "CURVE"); curve.bevel_depth = 0.1
    spline = curve.splines.new("BEZIER"); spline.bezier_points.add(2)
    for i, point in enumerate(spline.bezier_points):
        point.co = (i - 1, 1, 2); point.handle_left_type = point.handle_right_type = "AUTO"
    scene.collection.objects.link(bpy.data.objects.new("Ring", curve))
    text = bpy.data.curves.new("Text", "FONT"); text.body = "lego"
    scene.collection.objects.link(bpy.data.objects.new("Text", text))
    bones = bpy.data.objects.new("Bones", bpy.data.armatures.new("Bones"))
    scene.collection.objects.link(bones)
    dog.modifiers.new("Bones", "ARMATURE").object = bones
    dog.keyframe_insert("location", frame=1)

for name, compress in (("plain", False), ("packed", True)):
    varied(); (OUT / name).mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / name / "scene.blend"), compress=compress)
"""


def sources(built: Path, real: Path | None) -> dict[str, bytes]:
    """Name to bytes: the built files, the plain one inside gzip, and the real scenes if any."""
    plain = (built / "plain" / "scene.blend").read_bytes()
    found = {
        "plain": plain,
        "zstd": (built / "packed" / "scene.blend").read_bytes(),
        "gzip": gzip.compress(plain, compresslevel=1, mtime=0),
    }
    scenes = sorted((real / "scenes").glob("*/scene.blend")) if real is not None else []
    return found | {path.parent.name: path.read_bytes() for path in scenes}
