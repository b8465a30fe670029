"""scene.blend and the scene.glb that Blender exports of it: the same masks."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from legoworld import cli
from legoworld.api.scenes import Scene
from legoworld.running.inspection import open_scene
from legoworld.running.source_comparison import SourceComparison
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.folder import SceneFolder

EXPORT = """
def export(name, **more):
    save(name)
    bpy.ops.export_scene.gltf(
        filepath=str(OUT / name / "scene.glb"), export_format="GLB", export_extras=True,
        export_cameras=True, export_apply=True, use_renderable=True, **more
    )

def start(width=320, height=240, **settings):
    scene = fresh()
    scene.render.resolution_x, scene.render.resolution_y = width, height
    made = camera(**settings)
    made.location, made.rotation_euler = (2, -9, 5), (1.05, 0.1, 0.2)
    return scene

def ball(name, place, **properties):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=12, radius=0.8, location=place)
    made = bpy.context.object
    made.name = name
    for key, value in properties.items():
        made[key] = value
    return made

def card(name, x, material, z=0.0):
    made = quad(name, x=x, z=z, half=0.7)
    layer = made.data.uv_layers.new(name="UVMap")
    for i, corner in enumerate([(-0.5, -0.5), (1.5, -0.5), (1.5, 1.5), (-0.5, 1.5)]):
        layer.uv[i].vector = corner
    made.data.materials.append(material)

def leaf(name, image, **texture):
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    shader = next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED")
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    for key, value in texture.items():
        setattr(node, key, value)
    tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(node.outputs["Alpha"], shader.inputs["Alpha"])
    return material

def glass(name, alpha):
    material = bpy.data.materials.new(name)
    shader = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    shader.inputs["Alpha"].default_value = alpha
    return material
"""

SCENES = """
start()
top = bpy.data.objects.new("Chair", None)
bpy.context.scene.collection.objects.link(top)
top["category"], top["lvis_category"] = "chair", "armchair"
top.scale, top.rotation_euler = (1.5, 0.6, 1.1), (0.2, -0.3, 0.5)
for i in range(3):
    part = ball(f"Part{i}", (i - 1, 0.5 * i, 0))
    part.parent, part.scale = top, (0.5, 1, 0.7)
mirrored = ball("Mirrored", (2, 1, 1), category="vase")
mirrored.scale, mirrored.rotation_euler = (-1, 1.7, 0.4), (0.5, 0.6, 0.7)
flat = quad("Floor", z=-1.5, half=5)
flat.scale = (1, -1, 1)
export("hierarchy")

start()
stock = bpy.data.collections.new("Stock")
for name, place in (("Seat", (0, 0, 0)), ("Back", (0, 0.6, 0.7))):
    made = ball(name, place, **({"category": "chair"} if name == "Seat" else {}))
    bpy.context.scene.collection.objects.unlink(made)
    stock.objects.link(made)
    made.scale = (0.4, 0.4, 0.6)
for i in range(4):
    placed = bpy.data.objects.new(f"Placed{i}", None)
    placed.instance_type, placed.instance_collection = "COLLECTION", stock
    placed.location, placed.rotation_euler = (1.5 * i - 2, i - 1, 0), (0, 0, i)
    bpy.context.scene.collection.objects.link(placed)
shared = ball("Shared", (0, -2, -1))
for i in range(3):
    twin = bpy.data.objects.new(f"Twin{i}", shared.data)
    twin.location = (i - 1, -2, 1)
    twin.scale = (0.3, 0.3, 0.3)
    bpy.context.scene.collection.objects.link(twin)
export("instancing")

start(240, 320, lens=50)
ball("Ball", (0, 0, 0), category="ball"); quad("Wall", z=-1, half=4)
export("portrait")

start(320, 200, type="ORTHO", ortho_scale=7)
ball("Ball", (0, 0, 0), category="ball"); quad("Wall", z=-1, half=2)
export("orthographic")

start(300, 300, sensor_fit="VERTICAL", sensor_height=20, clip_start=8.5, clip_end=11)
bpy.context.scene.camera.scale = (2, 3, 0.5)
ball("Ball", (0, 0, 0)); quad("Wall", z=-1, half=9)
export("clipped")

start()
image = bpy.data.images.new("leaf", 8, 8, alpha=True)
image.pixels = [v for i in range(64) for v in (0.5, 0.5, 0.5, float((i * i // 5 + i // 8) % 3 > 0))]
image.pack()
for i, (wrap, how) in enumerate((
    ("REPEAT", "Linear"), ("EXTEND", "Linear"), ("MIRROR", "Closest"), ("REPEAT", "Closest")
)):
    card(f"Card{i}", 1.6 * i - 3, leaf(f"leaf{i}", image, extension=wrap, interpolation=how))
card("Thin", -1.5, glass("thin", 0.3), z=1.6)
card("Thick", 0.5, glass("thick", 0.7), z=1.6)
quad("Wall", z=-1, half=6)
export("alpha")

start()
made = ball("Smooth", (0, 0, 0), category="ball")
made.modifiers.new("s", "SUBSURF").render_levels = 2
made.modifiers["s"].levels = 2
twisted = ball("Twisted", (2, 0, 0))
twisted.shape_key_add(name="Basis")
key = twisted.shape_key_add(name="Big")
for point in key.data:
    point.co.z *= 2
key.value = 0.6
curve = bpy.data.curves.new("Word", "FONT")
curve.body, curve.extrude = "Hi", 0.1
word = bpy.data.objects.new("Word", curve)
word["category"] = "sign"
bpy.context.scene.collection.objects.link(word)
word.location = (-2, 0, 1)
hidden = ball("Hidden", (0, -3, 1)); hidden.hide_render = True
export("shapes")

start(shift_x=0.1)
bpy.context.scene.unit_settings.scale_length = 0.5
labelled = bpy.data.collections.new("Set")
labelled["category"] = "dining table"
bpy.context.scene.collection.children.link(labelled)
for i in range(2):
    part = ball(f"InSet{i}", (i, 0, 0))
    bpy.context.scene.collection.objects.unlink(part)
    labelled.objects.link(part)
moving = ball("Moving", (3, 0, 0))
for frame, x in ((1, 3), (11, -3)):
    moving.location.x = x
    moving.keyframe_insert("location", frame=frame)
bpy.context.scene.frame_set(6)
export("lost")
"""

AGREEING = ["hierarchy", "instancing", "portrait", "orthographic", "clipped", "alpha", "shapes"]


@pytest.fixture(scope="module")
def folder(build_scenes, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sources")
    build_scenes(EXPORT + SCENES, folder)
    return folder


@pytest.fixture(scope="module")
def blender():
    with BlenderProcess(Limits()) as process:
        yield process


def compare_sources_of(path: Path, blender, size_wh=None) -> SourceComparison:
    folder = SceneFolder(path=path, name=path.name)
    blend, glb = (
        Scene(open_scene(folder, source=file, blender=blender, cache=None))
        for file in ("blend", "glb")
    )
    view = blend.view(size_wh=size_wh)
    return view.compared_with(glb.view(size_wh=view.size_wh))


@pytest.mark.blender
@pytest.mark.parametrize(
    ("name", "size_wh"),
    [(name, size) for name in AGREEING for size in (None, (333, 250), (250, 333))
     if (name, size) != ("clipped", (333, 250))],
)  # fmt: skip
def test_every_shared_instance_agrees(name, size_wh, folder, blender):
    found = compare_sources_of(folder / name, blender, size_wh)
    assert len(found.pairs) >= 2
    assert {pair.name: pair.iou for pair in found.pairs if pair.iou < 0.999} == {}
    assert [pair.name for pair in found.pairs if pair.blend_category != pair.glb_category] == []
    assert [entry.name for entry in (*found.lost, *found.gained) if entry.area_px] == []
    same_triangles = [d for d in found.differences if "triangles became" not in d]
    assert same_triangles == []


@pytest.mark.blender
def test_a_sensor_fit_is_lost_in_pictures_of_another_aspect(folder, blender):
    found = compare_sources_of(folder / "clipped", blender, (333, 250))
    assert any(d.startswith("the projection's fx is") for d in found.differences)
    assert found.n_disagreeing == 2


@pytest.mark.blender
def test_instances_and_labels_survive(folder, blender):
    found = compare_sources_of(folder / "instancing", blender)
    named = sorted((pair.name, pair.glb_category) for pair in found.pairs)
    assert named.count(("Seat", "chair")) == 4
    assert [n for n, _ in named].count("Back") == 4
    (chair,) = [
        p for p in compare_sources_of(folder / "hierarchy", blender).pairs if p.name == "Chair"
    ]
    assert chair.glb_category == "chair"


@pytest.mark.blender
def test_what_is_lost_is_named(folder, blender, capsys):
    found = compare_sources_of(folder / "lost", blender)
    assert [entry.name for entry in found.lost] == ["Set"]
    assert sorted(entry.name for entry in found.gained) == ["InSet0", "InSet1"]
    text = "\n".join(found.differences)
    for line in (
        "lens shift 0.1, 0 is lost", "the unit scale is lost: 1 unit is 0.5 m",
        "labels of collections are lost: Set", "the projection's cx is 160.000 px, not 128.000",
        "depth is 2",
    ):  # fmt: skip
        assert line in text
    (moving,) = [pair for pair in found.pairs if pair.name == "Moving"]
    assert moving.iou < 0.5
    assert found.n_disagreeing == 1
    assert found.differing_px > moving.blend_area_px
    code = cli.run(["inspect", str(folder / "lost"), "--compare-sources", "--no-cache"])
    out = capsys.readouterr()
    assert code == 1
    assert out.out.splitlines()[2].split()[:2] == ["Moving", "-"]
    assert "only in scene.blend: 'Set', dining table" in out.out
    assert "differs: lens shift" in out.out
    assert "warning: scene.glb: scene.glb holds animations" in out.err


@pytest.mark.blender
def test_the_command_writes_both_sides(folder, tmp_path, capsys):
    scene = folder / "hierarchy"
    arguments = ["inspect", str(scene), "--compare-sources", "--json", "-o", str(tmp_path / "out")]
    assert cli.run(arguments) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["disagreeing"] == 0
    assert {"Chair", "Mirrored", "Floor"} == {p["name"] for p in document["instances"]}
    for source in ("blend", "glb"):
        assert (tmp_path / "out" / source / "overlay.png").is_file()
    shutil.copytree(scene, tmp_path / "half")
    (tmp_path / "half" / "scene.glb").unlink()
    assert cli.run(["inspect", str(tmp_path / "half"), "--compare-sources"]) == 2
    assert "holds no scene.glb" in capsys.readouterr().err


@pytest.mark.blender
@pytest.mark.real_data
def test_a_real_flat_agrees(real_data, tmp_path, blender):
    shutil.copy(real_data / "scenes" / "archx3d" / "scene.blend", tmp_path / "scene.blend")
    shutil.copy(real_data / "scenes" / "archx3d" / "model.glb", tmp_path / "scene.glb")
    found = compare_sources_of(tmp_path, blender, (960, 540))
    assert len(found.pairs) > 10
    assert (found.n_disagreeing, found.differing_px) == (0, 0)
    assert (found.lost, found.gained, found.differences) == ((), (), ())


@pytest.mark.blender
def test_what_execute_exports_keeps_collection_labels_and_the_saved_frame(tmp_path, blender):
    program = tmp_path / "program.py"
    program.write_text(
        """
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
labelled = bpy.data.collections.new("Set")
labelled["category"] = "dining table"
scene.collection.children.link(labelled)
for i in range(2):
    bpy.ops.mesh.primitive_cube_add(location=(3 * i, 0, 0))
    cube = bpy.context.object
    scene.collection.objects.unlink(cube)
    labelled.objects.link(cube)
cube.keyframe_insert("location", frame=1)
cube.location.y = 4
cube.keyframe_insert("location", frame=20)
scene.frame_set(20)
camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
camera.location.z = 25
scene.collection.objects.link(camera)
scene.camera = camera
"""
    )
    scene = tmp_path / "scene"
    assert cli.run(["execute", str(program), "-o", str(scene), "-q", "--no-picture"]) == 0
    found = compare_sources_of(scene, blender)
    assert [(p.name, p.glb_category, p.iou) for p in found.pairs] == [("Set", "dining table", 1.0)]
    assert not [d for d in found.differences if "collections" in d]
