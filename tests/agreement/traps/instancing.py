"""Everything that makes one object occur many times."""

from __future__ import annotations

from typing import Any

import bpy
from agreement.traps.stage import (
    Expect,
    camera,
    collection,
    floor,
    instance_of,
    link,
    solid,
    unlinked_collection,
    wall,
)


def nested_collections() -> Expect:
    """A collection instanced three deep, with offsets, turns and a negative scale on the way."""
    floor()
    cup = unlinked_collection("cup")
    cup.instance_offset = (0.1, 0, 0)
    solid("cylinder", "cup", (0, 0, 0.2), scale=(0.2, 0.2, 0.2), collection=cup)
    table = unlinked_collection("table")
    solid("cube", "top", (0, 0, 1), scale=(0.9, 0.6, 0.06), collection=table)
    solid("cylinder", "leg", (0, 0, 0.5), scale=(0.1, 0.1, 0.5), collection=table)
    instance_of(cup, "cup here", (-0.5, 0, 1.06), table)
    instance_of(cup, "cup there", (0.4, 0.2, 1.06), table, scale=(1, 1, 2))
    room = unlinked_collection("room")
    instance_of(table, "table a", (-1.2, 0, 0), room)
    instance_of(table, "table b", (1.2, 0, 0), room, rotation_euler=(0, 0, 0.6))
    instance_of(room, "room a", (-2.4, 0, 0))
    instance_of(room, "room b", (2.4, 1, 0), scale=(-1, 1, 1.3))
    camera()
    return Expect(seen=("cup", "top", "leg", "Floor"))


def instanced_hidden() -> Expect:
    """Members that are hidden, excluded or unseen where they stand, and instanced elsewhere."""
    floor()
    shown = collection("shown")
    solid("cube", "hidden member", (0, 0, 1), collection=shown).hide_render = True
    solid("cone", "member", (0, 0, 3), collection=shown)
    instance_of(shown, "again", (3, 0, 0))
    away = collection("away")
    solid("monkey", "excluded member", (0, 0, 1), collection=away)
    bpy.context.view_layer.layer_collection.children["away"].exclude = True
    instance_of(away, "away again", (-3, 0, 0))
    unrendered = collection("unrendered")
    solid("torus", "unrendered member", (0, 0, 1), collection=unrendered)
    unrendered.hide_render = True
    instance_of(unrendered, "unrendered again", (-3, 0, 2))
    camera()
    return Expect(seen=("member", "excluded member", "Floor"), unseen=("hidden member",))


def hidden_instancers() -> Expect:
    """Instancers hidden from the render, and one that the camera does not see."""
    floor()
    things = unlinked_collection("things")
    solid("cube", "thing", (0, 0, 1), collection=things)
    instance_of(things, "hidden", (-3, 0, 0)).hide_render = True
    instance_of(things, "eye closed", (0, 0, 0)).hide_viewport = True
    instance_of(things, "not for cameras", (3, 0, 0)).visible_camera = False
    camera()
    return Expect(seen=("thing",))


def _points_tree(name: str, source: Any, kind: str, realize: bool) -> Any:
    """Geometry nodes that put a source on every point, and keep the points' own mesh."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes, links = tree.nodes, tree.links
    given, result = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")
    place = nodes.new("GeometryNodeInstanceOnPoints")
    links.new(given.outputs[0], place.inputs["Points"])
    place.inputs["Scale"].default_value = (0.3, 0.2, -0.4)
    place.inputs["Rotation"].default_value = (0.2, 0.4, 0.6)
    if kind == "collection":
        info = nodes.new("GeometryNodeCollectionInfo")
        info.inputs["Collection"].default_value = source
        info.inputs["Separate Children"].default_value = True
        info.inputs["Reset Children"].default_value = True
        place.inputs["Pick Instance"].default_value = True
        links.new(info.outputs[0], place.inputs["Instance"])
    elif kind == "object":
        info = nodes.new("GeometryNodeObjectInfo")
        info.inputs["Object"].default_value = source
        info.inputs["As Instance"].default_value = True
        links.new(info.outputs["Geometry"], place.inputs["Instance"])
    else:
        links.new(nodes.new("GeometryNodeMeshCone").outputs["Mesh"], place.inputs["Instance"])
    last = place.outputs[0]
    if realize:
        last = links.new(last, nodes.new("GeometryNodeRealizeInstances").inputs[0]).to_node.outputs[
            0
        ]
    join = nodes.new("GeometryNodeJoinGeometry")
    links.new(last, join.inputs[0])
    links.new(given.outputs[0], join.inputs[0])
    links.new(join.outputs[0], result.inputs[0])
    return tree


def geometry_nodes() -> Expect:
    """Instances of objects, of a collection and of generated meshes; realised or not."""
    wall()
    pool = unlinked_collection("pool")
    solid("cube", "pool cube", collection=pool)
    solid("ico_sphere", "pool ball", collection=pool)
    hidden = solid("monkey", "prototype", (0, 0, 50))
    hidden.hide_render = True
    for i, (kind, source, realize) in enumerate(
        (("object", hidden, False), ("collection", pool, False), ("mesh", None, False),
         ("object", hidden, True))
    ):  # fmt: skip
        owner = solid("grid", f"grid {i}", (2.4 * (i - 1.5), 0, 0.5), x_subdivisions=3,
                      y_subdivisions=3, turn=(40, 0, 10 * i))  # fmt: skip
        tree = _points_tree(f"tree {i}", source, kind, realize)
        owner.modifiers.new("nodes", "NODES").node_group = tree
    camera()
    return Expect(
        seen=("grid 0", "grid 1", "grid 2", "grid 3", "prototype", "pool cube", "pool ball")
    )


def _particles(owner: Any, **settings: Any) -> Any:
    owner.modifiers.new("particles", "PARTICLE_SYSTEM")
    made = owner.particle_systems[0].settings
    for key, value in settings.items():
        setattr(made, key, value)
    return made


def hair_instances() -> Expect:
    """Particle hair that shows an object, and a collection; emitter shown and not shown."""
    wall()
    leaf = solid("cone", "leaf", (0, 0, -20), scale=(0.5, 0.2, 1))
    pool = unlinked_collection("pool")
    solid("cube", "pool cube", collection=pool)
    solid("torus", "pool ring", (0, 0, 1), collection=pool)
    ground = solid("plane", "ground", (-2.5, 0, 0), size=4)
    _particles(ground, type="HAIR", count=25, render_type="OBJECT", instance_object=leaf,
               particle_size=0.3, size_random=0.7, hair_length=1.0)  # fmt: skip
    ball = solid("uv_sphere", "bare ball", (2.5, 0, 1.5))
    ball.show_instancer_for_render = False
    _particles(ball, type="HAIR", count=25, render_type="COLLECTION", instance_collection=pool,
               particle_size=0.15, hair_length=1.0, use_rotations=True)  # fmt: skip
    camera()
    return Expect(seen=("leaf", "ground", "pool cube", "pool ring"), unseen=("bare ball",))


def emitted_particles() -> Expect:
    """Emitted particles at a frame in the middle of their life."""
    wall()
    drop = solid("ico_sphere", "drop", (0, 0, -20))
    source = solid("plane", "source", (0, 0, 3), size=5)
    _particles(source, type="EMITTER", count=40, frame_start=1, frame_end=1, lifetime=100,
               render_type="OBJECT", instance_object=drop, particle_size=0.25,
               physics_type="NO")  # fmt: skip
    bpy.context.scene.frame_set(5)
    camera()
    return Expect(seen=("drop", "source"))


def vertex_and_face_duplicates() -> Expect:
    """Children on the vertices (turned by normals) and on the faces (scaled) of their parent."""
    wall()
    bowl = solid(
        "uv_sphere", "bowl", (-2.5, 0, 1.5), segments=10, ring_count=6, scale=(1.5, 1, 1.5)
    )
    spike = solid("cone", "spike", scale=(0.1, 0.1, 0.3))
    spike.parent = bowl
    bowl.instance_type, bowl.use_instance_vertices_rotation = "VERTS", True
    dice = solid("ico_sphere", "dice", (2.5, 0, 1.5), subdivisions=2, scale=(1.5, 1.5, 1.5))
    chip = solid("cube", "chip", scale=(0.5, 0.5, 0.8))
    chip.parent = dice
    dice.instance_type, dice.use_instance_faces_scale = "FACES", True
    dice.show_instancer_for_render = False
    camera()
    return Expect(seen=("spike", "chip", "bowl"), unseen=("dice",))


def shared_mesh() -> Expect:
    """Objects that share one mesh, exact duplicates side by side, and a parented chain."""
    floor()
    first = solid("monkey", "first", (-3, 0, 1))
    for i in range(3):
        twin = link(bpy.data.objects.new(f"twin {i}", first.data))
        twin.location, twin.scale = (-1 + 1.8 * i, 0.4 * i, 1), (1 - 0.2 * i, 1, 1 + 0.3 * i)
        twin.parent = first if i == 2 else None
    camera()
    return Expect(seen=("first", "twin 0", "twin 1", "twin 2"))


TRAPS = (
    nested_collections,
    instanced_hidden,
    hidden_instancers,
    geometry_nodes,
    hair_instances,
    emitted_particles,
    vertex_and_face_duplicates,
    shared_mesh,
)
