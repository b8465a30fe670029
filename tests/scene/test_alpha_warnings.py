"""A warning about a material's alpha names that material, whatever other materials say the same."""

from __future__ import annotations

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
