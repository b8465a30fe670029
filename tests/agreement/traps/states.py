"""What only the render's own state knows: animation, drivers, simplification, node switches."""

from __future__ import annotations

from typing import Any

import bpy
from agreement.traps.stage import (
    Expect,
    camera,
    instance_of,
    material,
    polygons,
    principled,
    solid,
    unlinked_collection,
    wall,
)


def simplified() -> Expect:
    """Subdivision cut by the scene's Simplify, for the render otherwise than for the viewport."""
    wall()
    solid("cube", "cube", (0, 0, 1)).modifiers.new("s", "SUBSURF").render_levels = 4
    render = bpy.context.scene.render
    render.use_simplify, render.simplify_subdivision, render.simplify_subdivision_render = (
        True,
        0,
        1,
    )
    camera()
    return Expect(seen=("cube",))


def animated_switches() -> Expect:
    """Render visibility that is animated: hidden at the saved frame, and shown again."""
    wall()
    for name, x, first in (("hidden now", -2, False), ("shown now", 2, True)):
        made = solid("cube", name, (x, 0, 1))
        for frame, hidden in ((1, first), (5, not first)):
            made.hide_render = hidden
            made.keyframe_insert("hide_render", frame=frame)
    bpy.context.scene.frame_set(8)
    camera()
    return Expect(seen=("shown now",), unseen=("hidden now",))


def driven() -> Expect:
    """A driver by a simple expression, and a copied rotation."""
    wall()
    leader, follower = solid("cube", "leader", (-2, 0, 1)), solid("cube", "follower", (0, 0, 1))
    leader.rotation_euler = (0.3, 0.4, 0.5)
    follower.constraints.new("COPY_ROTATION").target = leader
    driver = follower.driver_add("location", 0).driver
    variable = driver.variables.new()
    variable.targets[0].id, variable.targets[0].data_path = leader, "location.y"
    driver.expression = "var + 2"
    camera()
    return Expect(seen=("leader", "follower"))


def camera_effects() -> Expect:
    """A render border, depth of field and motion blur take nothing away."""
    wall()
    moving = solid("cube", "moving", (0, 0, 1))
    for frame, x in ((1, 0.0), (3, 4.0)):
        moving.location.x = x
        moving.keyframe_insert("location", frame=frame)
    camera().data.dof.use_dof = True
    render = bpy.context.scene.render
    render.use_border = render.use_crop_to_border = render.use_motion_blur = True
    render.border_max_x = 0.4
    return Expect(seen=("moving", "Wall"))


def degenerate() -> Expect:
    """Flat and vanishing scales, and a mesh so small that only its object's scale shows it."""
    wall()
    solid("cube", "flat", (-2, 0, 1), scale=(1, 1, 0))
    solid("cube", "vanished", (0, 0, 1), scale=(0, 0, 0))
    tiny = solid("monkey", "tiny mesh", (2, 0, 1), scale=(1e4, 1e4, 1e4))
    for vertex in tiny.data.vertices:
        vertex.co *= 1e-4
    camera()
    return Expect(seen=("flat", "tiny mesh"), unseen=("vanished",))


def _tree(name: str) -> Any:
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    return tree


def is_viewport() -> Expect:
    """Geometry nodes that show a cone in the viewport and the cube in the render."""
    wall()
    tree = _tree("switch")
    nodes, links = tree.nodes, tree.links
    switch = nodes.new("GeometryNodeSwitch")
    switch.input_type = "GEOMETRY"  # a float in Blender 5.2 unless it is said
    links.new(nodes.new("GeometryNodeIsViewport").outputs[0], switch.inputs["Switch"])
    links.new(nodes.new("GeometryNodeMeshCone").outputs["Mesh"], switch.inputs["True"])
    links.new(nodes.new("NodeGroupInput").outputs[0], switch.inputs["False"])
    links.new(switch.outputs[0], nodes.new("NodeGroupOutput").inputs[0])
    solid("cube", "cube", (0, 0, 1)).modifiers.new("n", "NODES").node_group = tree
    camera()
    return Expect(seen=("cube",))


def nodes_over_instancers() -> Expect:
    """Geometry nodes that place a collection which holds an instancer itself."""
    wall()
    pool, inner = unlinked_collection("pool"), unlinked_collection("inner")
    solid("cube", "inner cube", (0, 0, 0.5), scale=(0.3, 0.3, 0.3), collection=inner)
    solid("cone", "cone", (0, 0, 1), scale=(0.3, 0.3, 0.3), collection=pool)
    instance_of(inner, "in", (0.5, 0, 0.5), pool)
    tree = _tree("place")
    nodes, links = tree.nodes, tree.links
    info, place = nodes.new("GeometryNodeCollectionInfo"), nodes.new("GeometryNodeInstanceOnPoints")
    info.inputs["Collection"].default_value = pool
    links.new(nodes.new("NodeGroupInput").outputs[0], place.inputs["Points"])
    links.new(info.outputs[0], place.inputs["Instance"])
    links.new(place.outputs[0], nodes.new("NodeGroupOutput").inputs[0])
    host = solid("grid", "host", (0, 0, 1), x_subdivisions=2, y_subdivisions=2, size=4)
    host.modifiers.new("n", "NODES").node_group = tree
    camera()
    return Expect(seen=("inner cube", "cone"), unseen=("host",))


def nodes_with_materials() -> Expect:
    """Letters made by nodes: one copy with a see-through material, one without any."""
    wall()
    tree = _tree("letters")
    nodes, links = tree.nodes, tree.links
    letters, fill = nodes.new("GeometryNodeStringToCurves"), nodes.new("GeometryNodeFillCurve")
    letters.inputs["String"].default_value = "Hi"
    dress, move = nodes.new("GeometryNodeSetMaterial"), nodes.new("GeometryNodeTransform")
    dress.inputs["Material"].default_value = principled("ghost", Alpha=0.2)
    move.inputs["Translation"].default_value = (0, 1.2, 0)
    join = nodes.new("GeometryNodeJoinGeometry")
    links.new(letters.outputs[0], fill.inputs[0])
    links.new(fill.outputs[0], dress.inputs[0])
    links.new(fill.outputs[0], move.inputs["Geometry"])
    links.new(dress.outputs[0], join.inputs[0])
    links.new(move.outputs[0], join.inputs[0])
    links.new(join.outputs[0], nodes.new("NodeGroupOutput").inputs[0])
    shown = polygons("letters", [], [], (-1, 0, 0.3))
    shown.rotation_euler, shown.scale = (1.5, 0, 0), (2, 1.5, 1)
    shown.modifiers.new("n", "NODES").node_group = tree
    camera()
    return Expect(seen=("letters",))


def displaced() -> Expect:
    """True displacement moves the surface in Cycles; we say that we read it unmoved."""
    wall()

    def bumpy(tree: Any) -> Any:
        output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
        move, noise = tree.nodes.new("ShaderNodeDisplacement"), tree.nodes.new("ShaderNodeTexNoise")
        move.inputs["Scale"].default_value = 2
        tree.links.new(noise.outputs[0], move.inputs["Height"])
        tree.links.new(move.outputs[0], output.inputs["Displacement"])
        return tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0]

    made = material("bumpy", bumpy)
    made.displacement_method = "DISPLACEMENT"
    solid("uv_sphere", "bumpy", (0, 0, 1), material=made)
    camera()
    return Expect(seen=("bumpy",), limited=("bumpy",))


TRAPS = (
    simplified,
    animated_switches,
    driven,
    camera_effects,
    degenerate,
    is_viewport,
    nodes_over_instancers,
    nodes_with_materials,
    displaced,
)
