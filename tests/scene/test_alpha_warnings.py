"""A warning about a material's alpha names that material, whatever other materials say the same."""

from __future__ import annotations

import numpy as np
import pytest
from scene.snapshots import read_alone

pytestmark = pytest.mark.blender

# Alpha comes from an attribute of the edges, which no rule reads.
PROGRAM = """
def material(name):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    attribute = nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = "worn"
    shader = next(n for n in nodes if n.type == "BSDF_PRINCIPLED")
    links.new(attribute.outputs["Fac"], shader.inputs["Alpha"])
    return made

def card(name, x, *materials):
    made = quad(name, x=x, half=0.4)
    made.data.attributes.new("worn", "FLOAT", "EDGE")
    for one in materials:
        made.data.materials.append(one)
    return made

fresh(); camera()
halves = bpy.data.meshes.new("halves")
corners = [(x, 5.0, z) for x in (3.0, 4.0) for z in (-0.5, 0.5)]
halves.from_pydata(corners + corners, [], [(0, 1, 3, 2), (4, 5, 7, 6)])
halves.attributes.new("worn", "FLOAT", "POINT").data.foreach_set("value", [0, 1] * 4)
halves.materials.append(None)
halves.materials.append(material("lace"))
halves.polygons[1].material_index = 1
bpy.context.scene.collection.objects.link(bpy.data.objects.new("Halves", halves))
card("One", -2.0, material("cloth"))
card("Other", -1.0, material("net"))
shared = card("Shared", 0.0, material("felt"))
again = bpy.data.objects.new("Again", shared.data)
bpy.context.scene.collection.objects.link(again)
again.location.x = 1.0
again.material_slots[0].link = "OBJECT"
again.material_slots[0].material = material("silk")
save("scene")
"""


def test_materials_of_equal_rules_are_named_each_by_its_own_name(build_scenes, tmp_path):
    build_scenes(PROGRAM, tmp_path)
    read = read_alone(tmp_path / "scene")
    assert read.snapshot.warnings == tuple(
        f"material '{name}': alpha comes from an attribute of every edge; its surface is taken as "
        "opaque"
        for name in ("cloth", "felt", "net", "silk")
    )


def test_one_material_is_cut_and_the_other_of_its_mesh_is_whole(build_scenes, tmp_path):
    build_scenes(PROGRAM, tmp_path)
    snapshot = read_alone(tmp_path / "scene").snapshot
    assert len(snapshot.cutouts) == 1
    assert sorted(snapshot.triangle_cutout.tolist()) == [-1] * (len(snapshot.triangles) - 2) + [
        0,
        0,
    ]
    cut = np.flatnonzero(snapshot.triangle_cutout == 0)
    assert len(cut) == 2
    assert snapshot.triangle_cutout[cut[0] - 2 :][:4].tolist() == [-1, -1, 0, 0]
