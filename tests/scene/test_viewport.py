"""Opening without the viewport's evaluation gives the same snapshot, or is not done."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.blender

SCENES = """
def geometry_tree(name):
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    return tree, tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")

def simulated(made):
    tree, first, last = geometry_tree("Remembers")
    before = tree.nodes.new("GeometryNodeSimulationInput")
    after = tree.nodes.new("GeometryNodeSimulationOutput")
    before.pair_with_output(after)
    move = tree.nodes.new("GeometryNodeTransform")
    move.inputs["Translation"].default_value = (0.5, 0, 0)
    tree.links.new(first.outputs[0], before.inputs["Geometry"])
    tree.links.new(before.outputs["Geometry"], move.inputs[0])
    tree.links.new(move.outputs[0], after.inputs["Geometry"])
    tree.links.new(after.outputs["Geometry"], last.inputs[0])
    made.modifiers.new("Nodes", "NODES").node_group = tree

def keyed(made):
    made.location.x = 1
    made.keyframe_insert("location", frame=1)
    made.location.x = 3
    made.keyframe_insert("location", frame=11)
    bpy.context.scene.frame_current = 6

def driven(made):
    driver = made.driver_add("location", 0).driver
    driver.expression = "0.25"

def driven_material(made):
    material = bpy.data.materials.new("Driven")
    material.use_nodes = True
    alpha = material.node_tree.nodes["Principled BSDF"].inputs["Alpha"]
    alpha.driver_add("default_value").driver.expression = "1.0"
    made.data.materials.append(material)

def marked(made):
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    other.location.z = 6
    bpy.context.scene.collection.objects.link(other)
    bpy.context.scene.timeline_markers.new("Cut", frame=1).camera = other

def scattered(made):
    made.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = made.particle_systems[0].settings
    settings.count, settings.render_type = 5, "OBJECT"
    settings.frame_start = settings.frame_end = 1
    settings.instance_object = quad("Grain", x=5, half=0.2)

def collided(made):
    bpy.ops.rigidbody.world_add()

def subdivided(made):
    made.modifiers.new("Smooth", "SUBSURF").render_levels = 3
    made.modifiers.new("Thick", "SOLIDIFY")

def arrayed(made):
    for i in range(3):
        twin = bpy.data.objects.new("Twin", made.data)
        twin.parent, twin.location = made, (i, 1, 1)
        bpy.context.scene.collection.objects.link(twin)
    text = bpy.data.objects.new("Word", bpy.data.curves.new("Word", "FONT"))
    text.data.body = "legoworld"
    bpy.context.scene.collection.objects.link(text)
    child = bpy.data.collections.new("Child")
    child.objects.link(made)
    copy = bpy.data.objects.new("Copy", None)
    copy.instance_type, copy.instance_collection, copy.location.y = "COLLECTION", child, 2
    bpy.context.scene.collection.objects.link(copy)

def several(made):
    bpy.data.scenes.new("Another")
    bpy.data.scenes.new("Nothing to see")

def waved(made):
    made.modifiers.new("Fine", "SUBSURF").render_levels = 4
    made.modifiers.new("Wave", "WAVE").height = 0.5
    bpy.context.scene.render.frame_map_old, bpy.context.scene.render.frame_map_new = 100, 50
    bpy.context.scene.frame_set(40, subframe=0.5)

def clocked(made):
    tree, first, last = geometry_tree("Clock")
    time = tree.nodes.new("GeometryNodeInputSceneTime")
    move = tree.nodes.new("GeometryNodeTransform")
    tree.links.new(first.outputs[0], move.inputs[0])
    tree.links.new(time.outputs["Seconds"], move.inputs["Translation"])
    tree.links.new(move.outputs[0], last.inputs[0])
    made.modifiers.new("Nodes", "NODES").node_group = tree
    bpy.context.scene.frame_set(-7)

def plain(made):
    pass

for change in (simulated, keyed, driven, driven_material, marked, scattered, collided, subdivided,
               arrayed, several, waved, clocked, plain):
    fresh(); camera()
    made = quad("Thing")
    change(made)
    save(change.__name__)
"""

WATCHED = {"simulated", "keyed", "driven", "driven_material", "marked", "scattered", "collided"}


def read_twice(paths: list[Path]) -> dict[str, list[object]]:
    done = subprocess.run(
        [sys.executable, str(Path(__file__).parent / "unwatched.py"), *map(str, paths)],
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return {Path(path).parent.name: found for path, found in json.loads(done.stdout).items()}


@pytest.fixture(scope="module")
def found(build_scenes, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[object]]:
    folder = tmp_path_factory.mktemp("viewport")
    build_scenes(SCENES, folder)
    return read_twice(sorted(folder.glob("*/scene.blend")))


def test_the_snapshot_is_the_same(found):
    assert len(found) == 13
    assert {name for name, (_, without, whole) in found.items() if without != whole} == set()


def test_what_could_leave_marks_is_evaluated_for_the_viewport(found):
    assert {name for name, (left_out, _, _) in found.items() if not left_out} == WATCHED


@pytest.mark.real_data
def test_foreign_scenes_are_the_same(real_data):
    files = sorted(p for p in real_data.rglob("scene.blend") if p.stat().st_size < 60e6)
    found = read_twice(files)
    assert any(left_out for left_out, _, _ in found.values())
    assert {name for name, (_, without, whole) in found.items() if without != whole} == set()
