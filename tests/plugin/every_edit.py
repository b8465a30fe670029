"""A scene with a datablock of each kind, and one edit of each kind of setting."""

from __future__ import annotations

#: Each edit by its name: the entity that it changes, and the code. `o` is bpy.data.objects, `s` the
#: scene, `m` the material Wood, `n` its nodes.
# ruff: noqa: E501  one edit a line
EDITS: dict[str, tuple[str, str]] = {
    # Objects.
    "location": ("Cube", "o['Cube'].location.x += 1"),
    "rotation": ("Cube", "o['Cube'].rotation_euler.z += 1"),
    "scale": ("Cube", "o['Cube'].scale.x = 2"),
    "delta_location": ("Cube", "o['Cube'].delta_location.x = 2"),
    "object_property": ("Cube", "o['Cube']['mark'] = 2"),
    "hide_render": ("Cube", "o['Cube'].hide_render = True"),
    "visible_shadow": ("Cube", "o['Cube'].visible_shadow = False"),
    "visible_camera": ("Cube", "o['Cube'].visible_camera = False"),
    "visible_glossy": ("Cube", "o['Cube'].visible_glossy = False"),
    "shadow_catcher": ("Cube", "o['Cube'].is_shadow_catcher = True"),
    "holdout": ("Cube", "o['Cube'].is_holdout = True"),
    "object_colour": ("Cube", "o['Cube'].color = (1, 0, 0, 1)"),  # of the node Object Info
    "line_art": ("Cube", "o['Cube'].lineart.usage = 'EXCLUDE'"),
    "pass_index": ("Cube", "o['Cube'].pass_index = 3"),
    "cycles_of_object": ("Cube", "o['Cube'].cycles.shadow_terminator_offset = .5"),
    "light_linking": ("Cube", "o['Cube'].light_linking.receiver_collection = bpy.data.collections['Linked']"),
    "light_link_state": ("collections", "bpy.data.collections['Linked'].collection_objects[0].light_linking.link_state = 'EXCLUDE'"),
    "instancing": ("Empty", "o['Empty'].instance_type = 'NONE'"),
    "instance_collection": ("Empty", "o['Empty'].instance_collection = bpy.data.collections['Linked']"),
    "object_keyframe": ("Cube", "o['Cube'].keyframe_insert('location', frame=7)"),
    "keyframe_value": ("Moving", "fcurve().keyframe_points[0].co[1] += 1"),
    "keyframe_interpolation": ("Moving", "fcurve().keyframe_points[0].interpolation = 'CONSTANT'"),
    "fcurve_modifier": ("Moving", "fcurve().modifiers.new('CYCLES')"),
    "fcurve_muted": ("Moving", "fcurve().mute = True"),
    "object_driver": ("Cube", "o['Cube'].driver_add('scale', 0).driver.expression = '2'"),
    "driver_expression": ("Driven", "o['Driven'].animation_data.drivers[0].driver.expression = '7'"),
    "nla_strip": ("Moving", "o['Moving'].animation_data.nla_tracks.new().strips.new('x', 1, bpy.data.actions[0])"),
    "constraint": ("Cube", "o['Cube'].constraints.new('TRACK_TO')"),
    "constraint_setting": ("Driven", "o['Driven'].constraints[0].influence = .5"),
    "modifier": ("Cube", "o['Cube'].modifiers.new('B', 'BEVEL')"),
    "modifier_setting": ("Driven", "o['Driven'].modifiers['Array'].count = 5"),
    "modifier_render": ("Driven", "o['Driven'].modifiers['Array'].show_render = False"),
    "geometry_nodes_input": ("Driven", "o['Driven'].modifiers['Nodes'][socket()] = 3."),
    "geometry_node": ("Driven", "bpy.data.node_groups['Geo'].nodes['T'].inputs['Translation'].default_value[0] = 4"),
    "particles": ("Driven", "bpy.data.particles[0].count = 5"),
    "particle_seed": ("Driven", "o['Driven'].particle_systems[0].seed = 5"),
    "rigid_body": ("Cube", "o['Cube'].rigid_body.mass = 7"),
    "vertex_group": ("Cube", "o['Cube'].vertex_groups.new(name='V')"),
    "pose": ("Rig", "o['Rig'].pose.bones[0].location.x = 1"),
    "pose_constraint": ("Rig", "o['Rig'].pose.bones[0].constraints.new('COPY_LOCATION')"),
    "bone_property": ("Rig", "o['Rig'].pose.bones[0]['mark'] = 1"),
    "parented": ("Cube", "o['Cube'].parent = o['Empty']"),
    "parent_type": ("Child", "o['Child'].parent_type = 'VERTEX'"),
    # What objects hold.
    "vertex": ("Cube", "o['Cube'].data.vertices[0].co.x += 1"),
    "uv": ("Cube", "o['Cube'].data.uv_layers[0].uv[0].vector[0] += .5"),
    "uv_rendered": ("Cube", "o['Cube'].data.uv_layers[1].active_render = True"),
    "colour_attribute": ("Cube", "o['Cube'].data.color_attributes[0].data[0].color[0] = .25"),
    "sharp_edge": ("Cube", "o['Cube'].data.edges[0].use_edge_sharp = True"),
    "smooth_face": ("Cube", "o['Cube'].data.polygons[0].use_smooth = True"),
    "face_material": ("Cube", "o['Cube'].data.polygons[0].material_index = 1"),
    "mesh_property": ("Cube", "o['Cube'].data['mark'] = 1"),
    "shape_key_value": ("Keyed", "o['Keyed'].data.shape_keys.key_blocks[1].value = .5"),
    "shape_key_point": ("Keyed", "o['Keyed'].data.shape_keys.key_blocks[1].data[0].co[2] += 1"),
    "shape_key_driver": ("Keyed", "o['Keyed'].data.shape_keys.key_blocks[1].driver_add('value').driver.expression = '1'"),
    "curve_point": ("Curve", "o['Curve'].data.splines[0].bezier_points[0].co.x += 1"),
    "curve_bevel": ("Curve", "o['Curve'].data.bevel_depth = .2"),
    "text": ("Text", "o['Text'].data.body = 'other'"),
    "metaball": ("Meta", "o['Meta'].data.elements[0].radius = 3"),
    "lattice": ("Lattice", "o['Lattice'].data.points[0].co_deform[0] += 1"),
    "light_energy": ("Lamp", "o['Lamp'].data.energy = 5"),
    "light_nodes": ("Lamp", "o['Lamp'].data.use_nodes = True; o['Lamp'].data.node_tree.nodes[0].mute = True"),
    "light_property": ("Lamp", "o['Lamp'].data['mark'] = 1"),
    "light_keyframe": ("Lamp", "o['Lamp'].data.keyframe_insert('energy', frame=3)"),
    "lens": ("camera", "s.camera.data.lens = 20"),
    "depth_of_field": ("camera", "s.camera.data.dof.use_dof = True"),
    "camera_shift": ("camera", "s.camera.data.shift_y = .1"),
    "active_camera": ("camera", "s.camera = o['Other camera']"),
    "armature": ("Rig", "o['Rig'].data.pose_position = 'REST'"),
    # Materials.
    "node_value": ("Cube", "n['Principled BSDF'].inputs['Roughness'].default_value = .9"),
    "node_link": ("Cube", "m.node_tree.links.remove(m.node_tree.links[0])"),
    "node_muted": ("Cube", "n['Principled BSDF'].mute = True"),
    "node_added": ("Cube", "n.new('ShaderNodeTexNoise')"),
    "output_chosen": ("Cube", "n['Other output'].is_active_output = True"),
    "node_group": ("Cube", "bpy.data.node_groups['Group'].nodes['Mix'].inputs[0].default_value = .9"),
    "node_image": ("Cube", "n['Picture'].image.alpha_mode = 'NONE'"),
    "pixels": ("Cube", "i = n['Picture'].image; i.pixels[0] = .5; i.pack()"),
    "texture_interpolation": ("Cube", "n['Picture'].interpolation = 'Closest'"),
    "colour_ramp": ("Cube", "n['Ramp'].color_ramp.elements[0].position = .4"),
    "material_blend": ("Cube", "m.surface_render_method = 'BLENDED'"),
    "material_culling": ("Cube", "m.use_backface_culling = True"),
    "material_property": ("Cube", "m['mark'] = 1"),
    "material_driver": ("Cube", "n['Principled BSDF'].inputs['Roughness'].driver_add('default_value').driver.expression = '1'"),
    "material_keyframe": ("Cube", "n['Principled BSDF'].inputs['Roughness'].keyframe_insert('default_value', frame=2)"),
    # The scene's own.
    "engine": ("render", "s.render.engine = 'BLENDER_WORKBENCH'"),
    "film_transparent": ("render", "s.render.film_transparent = True"),
    "cycles_samples": ("render", "s.cycles.samples = 3"),
    "eevee": ("render", "s.eevee.taa_render_samples = 3"),
    "exposure": ("render", "s.view_settings.exposure = 1"),
    "look_curve": ("render", "s.view_settings.use_curve_mapping = True"),
    "display_device": ("render", "s.display_settings.display_device = 'Display P3'"),
    "strip": ("render", "s.sequence_editor.strips.new_effect('Red', 'COLOR', 2, 1, length=9)"),
    "strip_setting": ("render", "s.sequence_editor.strips[0].color = (0, 1, 0)"),
    "material_override": ("render", "s.view_layers[0].material_override = m"),
    "view_layer_use": ("render", "s.view_layers[0].use = False"),
    "view_layer_pass": ("render", "s.view_layers[0].use_pass_mist = True"),
    "view_layer_added": ("render", "s.view_layers.new('More')"),
    "frame": ("render", "s.frame_current = 4"),
    "marker": ("render", "s.timeline_markers.new('cut', frame=1).camera = o['Other camera']"),
    "gravity": ("render", "s.gravity = (0, 0, -1)"),
    "scene_property": ("render", "s['mark'] = 1"),
    "scene_keyframe": ("render", "s.view_settings.keyframe_insert('exposure', frame=2)"),
    "compositor": ("render", "s.compositing_node_group.nodes['Blur'].mute = True"),
    "world_node": ("world", "s.world.node_tree.nodes['Background'].inputs['Strength'].default_value = 3"),
    "world_mist": ("world", "s.world.mist_settings.depth = 3"),
    "world_property": ("world", "s.world['mark'] = 1"),
    "world_driver": ("world", "s.world.driver_add('color', 0).driver.expression = '1'"),
    "world_swapped": ("world", "s.world = bpy.data.worlds.new('Night')"),
    "layer_excluded": ("collections", "s.view_layers[0].layer_collection.children[0].exclude = True"),
    "layer_indirect": ("collections", "s.view_layers[0].layer_collection.children[0].indirect_only = True"),
    "collection_hidden": ("collections", "bpy.data.collections['Part'].hide_render = True"),
    "collection_offset": ("collections", "bpy.data.collections['Linked'].instance_offset = (1, 0, 0)"),
    "collection_property": ("collections", "bpy.data.collections['Part']['mark'] = 1"),
    "collection_child": ("collections", "bpy.data.collections['Part'].children.link(bpy.data.collections['Linked'])"),
}  # fmt: skip

#: What a window does, Blender itself, or nothing.
NO_EDITS: dict[str, str] = {
    "nothing": "pass",
    "saved_twice": "save('saved_twice'); bpy.ops.wm.open_mainfile(filepath=place('saved_twice'))",
    "selected": "o['Cube'].select_set(True); o['Lamp'].select_set(True)",
    "viewport": "o['Cube'].display_type = 'WIRE'; o['Cube'].show_name = True",
    "node_moved": "n['Principled BSDF'].location = (7, 7)",
    "cursor": "s.cursor.location = (1, 2, 3)",
    "evaluated": "bpy.context.evaluated_depsgraph_get().update()",
    "frames_and_back": "s.frame_set(9); s.frame_set(1)",
    "rendered": "s.render.engine = 'CYCLES'; e = s.cycles.samples; s.cycles.samples = 1; "
                "s.render.filepath, f = place('x') + '.png', s.render.filepath; "
                "bpy.ops.render.render(write_still=True); s.cycles.samples = e; s.render.filepath = f",
    "unused_block": "bpy.data.materials.new('Nobody')",
}  # fmt: skip

SCENE_AND_EDITS = """
import json

def place(name):
    return str(OUT / name / "scene.blend")

def save(name):
    (OUT / name).mkdir(exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=place(name))

def put(name, data, into=None):
    made = bpy.data.objects.new(name, data)
    (into or bpy.context.scene.collection).objects.link(made)
    return made

def fcurve():
    action = bpy.data.objects["Moving"].animation_data.action
    return action.layers[0].strips[0].channelbags[0].fcurves[0]

def socket():
    return next(i.identifier for i in bpy.data.node_groups["Geo"].interface.items_tree
                if i.in_out == "INPUT" and i.name == "Size")

def box(name, half):
    ends = (-half, half)
    corners = [(x, y, z) for x in ends for y in ends for z in ends]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh(name, corners, sides)

def everything():
    s = fresh()
    s.render.engine = "CYCLES"
    s.render.resolution_x, s.render.resolution_y = 32, 24
    held = camera(0, lens=30)
    held.location, held.rotation_euler = (0, -9, 2), (1.4, 0, 0)
    put("Other camera", bpy.data.cameras.new("Other"))
    part, linked = bpy.data.collections.new("Part"), bpy.data.collections.new("Linked")
    s.collection.children.link(part)
    linked.use_fake_user = True
    cube = box("Cube", 1)
    part.objects.link(cube)
    linked.objects.link(cube)
    cube["mark"] = 1
    cube.data.uv_layers.new(name="One"), cube.data.uv_layers.new(name="Two")
    cube.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    m = bpy.data.materials.new("Wood")
    m.use_nodes = True
    cube.data.materials.append(m)
    cube.data.materials.append(bpy.data.materials.new("Steel"))
    n = m.node_tree.nodes
    n.new("ShaderNodeOutputMaterial").name = "Other output"
    n["Material Output"].is_active_output = True
    picture = n.new("ShaderNodeTexImage")
    picture.name, picture.image = "Picture", bpy.data.images.new("Stored", 4, 4)
    picture.image.pack()
    n.new("ShaderNodeValToRGB").name = "Ramp"
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    group.nodes.new("ShaderNodeMix").name = "Mix"
    n.new("ShaderNodeGroup").node_tree = group
    moving = box("Moving", .5)
    moving.keyframe_insert("location", frame=1)
    moving.keyframe_insert("location", frame=20)
    driven = box("Driven", .5)
    driven.location.x = 4
    driven.driver_add("location", 2).driver.expression = "1"
    driven.constraints.new("LIMIT_LOCATION")
    driven.modifiers.new("Array", "ARRAY")
    geo = bpy.data.node_groups.new("Geo", "GeometryNodeTree")
    geo.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    geo.interface.new_socket("Size", in_out="INPUT", socket_type="NodeSocketFloat")
    geo.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = geo.nodes.new("NodeGroupInput"), geo.nodes.new("NodeGroupOutput")
    shift = geo.nodes.new("GeometryNodeTransform")
    shift.name = "T"
    geo.links.new(start.outputs[0], shift.inputs[0])
    geo.links.new(shift.outputs[0], end.inputs[0])
    driven.modifiers.new("Nodes", "NODES").node_group = geo
    driven.modifiers.new("Dust", "PARTICLE_SYSTEM")
    keyed = box("Keyed", .3)
    keyed.location.x = -4
    keyed.shape_key_add(name="Basis"), keyed.shape_key_add(name="Bent")
    child = box("Child", .2)
    child.parent = cube
    empty = put("Empty", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", part
    empty.location.y = 9
    curve = bpy.data.curves.new("Curve", "CURVE")
    curve.splines.new("BEZIER").bezier_points.add(1)
    put("Curve", curve)
    text = bpy.data.curves.new("Text", "FONT")
    text.body = "word"
    put("Text", text)
    meta = bpy.data.metaballs.new("Meta")
    meta.elements.new()
    put("Meta", meta).location.z = 5
    put("Lattice", bpy.data.lattices.new("Lattice"))
    put("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    rig = put("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("Bone")
    bone.tail = (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    s.world = bpy.data.worlds.new("Day")
    s.world.use_nodes = True
    bpy.context.view_layer.objects.active = cube
    bpy.ops.rigidbody.world_add()
    bpy.ops.rigidbody.object_add()
    s.sequence_editor_create().strips.new_effect("Back", "COLOR", 1, 1, length=20)
    s.render.use_sequencer = False
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.nodes.new("CompositorNodeBlur").name = "Blur"
    s.compositing_node_group = tree
    s.render.use_compositing = False

everything()
save("start")
for name, code in json.loads(EDITS).items():
    bpy.ops.wm.open_mainfile(filepath=place("start"))
    o, s, m = bpy.data.objects, bpy.context.scene, bpy.data.materials["Wood"]
    n = m.node_tree.nodes
    exec(code)
    save(name)
"""
