"""A room with furniture, and edits of it, as programs for the tests' own Blender."""

from __future__ import annotations

#: Saves OUT / room / scene.blend, then one folder for every edit.
ROOM_AND_EDITS = """
import mathutils

def box(name, low, high, **properties):
    (x, y, z), (X, Y, Z) = low, high
    square = [(x, y), (X, y), (X, Y), (x, Y)]
    corners = [(*c, z) for c in square] + [(*c, Z) for c in square]
    faces = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    return mesh(name, corners, faces, **properties)

def room():
    scene = fresh()
    scene.render.resolution_x, scene.render.resolution_y = 160, 120
    held = camera(0, lens=30)
    held.location, held.rotation_euler = (0, -5, 2), (1.35, 0, 0)
    box("Floor", (-3, -3, -0.1), (3, 3, 0))
    box("Table", (-1, -0.5, 0), (1, 0.5, 0.75), category="dining table")
    box("Cup", (-0.1, -0.1, 0.75), (0.1, 0.1, 1.0), category="cup")
    box("Chair", (-0.25, -1.5, 0), (0.25, -1, 0.5), category="chair")
    box("Crate", (1.5, 0, 0), (2.1, 0.6, 0.6))
    child = box("Lid", (-0.3, -0.3, 0), (0.3, 0.3, 0.05))
    child.parent, child.location = bpy.data.objects["Crate"], (1.8, 0.3, 0.6)
    material = bpy.data.materials.new("Wood")
    material.use_nodes = True
    bpy.data.objects["Table"].data.materials.append(material)
    bpy.data.objects["Crate"]["traits"] = [{"of": "wood", "at": [1.0, 2.0]}, {"of": "nails"}]
    scene.world = bpy.data.worlds.new("World")
    light = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    scene.collection.objects.link(light)
    return scene

def edit_none(o): pass
def edit_moved(o): o["Cup"].location.x += 0.5
def edit_parent_moved(o): o["Crate"].location.y += 0.2
def edit_vertex(o): o["Chair"].data.vertices[0].co.z += 0.01
def edit_material_colour(o):
    nodes = bpy.data.materials["Wood"].node_tree.nodes
    nodes["Principled BSDF"].inputs["Base Color"].default_value = (1, 0, 0, 1)
def edit_material_swapped(o):
    o["Table"].data.materials[0] = bpy.data.materials.new("Steel")
def edit_node_moved_in_editor(o):
    bpy.data.materials["Wood"].node_tree.nodes["Principled BSDF"].location = (9, 9)
def edit_selected(o): o["Cup"].select_set(True)
def edit_lens(o): bpy.context.scene.camera.data.lens = 40
def edit_camera_turned(o): bpy.context.scene.camera.rotation_euler.z = 0.1
def edit_hidden(o): o["Cup"].hide_render = True
def edit_deleted(o): bpy.data.objects.remove(o["Chair"])
def edit_added(o): box("Vase", (0.5, 0, 0.75), (0.6, 0.1, 1))
def edit_renamed(o): o["Cup"].name = "Mug"
def edit_modifier(o): o["Cup"].modifiers.new("Round", "BEVEL")
def edit_relabelled(o): o["Cup"]["category"] = "bowl"
def edit_trait(o): o["Crate"]["traits"][1]["of"] = "screws"
def edit_resolution(o): bpy.context.scene.render.resolution_x = 80
def edit_world(o): bpy.context.scene.world.color = (1, 0, 0)
def edit_light(o): o["Lamp"].data.energy = 7
def edit_unparented(o):
    o["Lid"].parent = None
def edit_collected(o):
    into = bpy.data.collections.new("Kitchen")
    bpy.context.scene.collection.children.link(into)
    into.objects.link(o["Cup"])

for name, edit in [(k[5:], v) for k, v in list(globals().items()) if k.startswith("edit_")]:
    room()
    edit(bpy.data.objects)
    (OUT / name).mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / name / "scene.blend"))
"""
