"""USD by Blender's exporter, opened by usd-core; and back, with labels of both kinds."""

from __future__ import annotations

import json

import pytest

from legoworld.api.exporting import export
from legoworld.api.scene_folders import import_usd
from legoworld.api.scenes import open_scene
from legoworld.errors import LegoWorldError, UsageError

SCENES = """
def collection(name, *names, **properties):
    made = bpy.data.collections.new(name)
    for key, value in properties.items():
        made[key] = value
    for one in names:
        shown = bpy.data.objects[one]
        bpy.context.scene.collection.objects.unlink(shown)
        made.objects.link(shown)
    return made

scene = fresh()
scene.unit_settings.scale_length = 0.01
camera()
quad("Sofa.001", x=-3, category="couch").scale = (1, 1.5, 1)
arm = quad("Arm", x=1, half=0.4)
arm.parent, arm.rotation_euler = bpy.data.objects["Sofa.001"], (0, 0, 0.5)
quad("Pin", x=-3, z=0.5, half=0.1, category="button").parent = bpy.data.objects["Sofa.001"]
quad("Seat", x=1, half=0.5)
quad("Leg", x=1, y=-1, half=0.3)
scene.collection.children.link(collection("Chair", "Seat", "Leg", category="chair"))
quad("Body", half=0.3)
bottle = collection("Bottle", "Body", category="bottle")
for i in range(3):
    place = bpy.data.objects.new(f"Bottle at {i}", None)
    place.instance_type, place.instance_collection = "COLLECTION", bottle
    place.location = (3, i - 1, 0)
    scene.collection.objects.link(place)
quad("Floor", z=-1, half=6).modifiers.new("Rounded", "SUBSURF").render_levels = 3
save("room")
"""
#: By hand: labels of the older API, and a mesh in centimetres whose parent is no part of it.
OLD = """#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 0.01
    upAxis = "Z"
)
def Xform "World" {
    def Camera "View" {
        double3 xformOp:translate = (0, 0, 10)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Mesh "Car" (prepend apiSchemas = ["SemanticsAPI:Semantics_a", "SemanticsAPI:Semantics_b"]) {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
        string semantic:Semantics_a:params:semanticType = "class"
        string semantic:Semantics_a:params:semanticData = "car"
        string semantic:Semantics_b:params:semanticType = "color"
        string semantic:Semantics_b:params:semanticData = "red"
    }
    def Mesh "Tree" (prepend apiSchemas = ["SemanticsLabelsAPI:a", "SemanticsLabelsAPI:b"]) {
        token[] semantics:labels:a = ["tree"]
        token[] semantics:labels:b = ["plant"]
    }
    def Mesh "Dog" (prepend apiSchemas = ["SemanticsLabelsAPI:animal"]) {
        token[] semantics:labels:animal = ["dog", "terrier"]
    }
}
"""
pytestmark = pytest.mark.blender
SIZE = (64, 48)


@pytest.fixture(scope="module")
def usd(scenes, tmp_path_factory):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    output = tmp_path_factory.mktemp("usd") / "out"
    written = export(scenes / "room", output, format="usd", cache=False)
    assert (written.annotations, written.losses, written.failed) == (6, (), {})
    assert json.loads((output / "legoworld.json").read_text())["format"] == "usd"
    return output / "room" / "scene.usdc"


def test_usd_core_finds_each_label_on_the_prims_of_its_instance(usd):
    from pxr import Usd, UsdGeom, UsdSemantics

    stage = Usd.Stage.Open(str(usd))
    assert UsdGeom.GetStageMetersPerUnit(stage) == pytest.approx(0.01)
    labels = {}
    for prim in stage.Traverse():
        taxonomies = UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim)
        if taxonomies:
            assert sorted(taxonomies) == ["class", "instance"]
            assert prim.HasAPI(UsdSemantics.LabelsAPI, "class")
            labels[prim.GetName()] = [
                str(prim.GetAttribute(f"semantics:labels:{t}").Get()[0])
                for t in ("class", "instance")
            ]
    assert {name: label[0] for name, label in labels.items()} == {
        "Sofa_001": "couch", "Pin": "button", "Seat": "chair", "Leg": "chair",
        "Bottle_at_0": "bottle", "Bottle_at_1": "bottle", "Bottle_at_2": "bottle",
    }  # fmt: skip
    assert labels["Seat"][1] == labels["Leg"][1]
    assert len({label[1] for label in labels.values()}) == 6
    arm = stage.GetPrimAtPath("/root/Sofa_001/Arm")
    query = UsdSemantics.LabelsQuery("class", Usd.TimeCode.Default())
    assert query.ComputeUniqueInheritedLabels(arm) == ["couch"]


def test_the_scene_comes_back_as_it_was(usd, scenes, tmp_path):
    made = import_usd(usd, tmp_path / "back")
    assert (made.labelled, made.losses) == (7, ())
    before, after = (
        open_scene(folder, cache=False).view(size_wh=SIZE)
        for folder in (scenes / "room", tmp_path / "back")
    )
    assert after.render.unit_scale == pytest.approx(0.01)
    seen = [
        sorted((i.category, i.area_px, i.bbox_xywh_px, len(i.objects)) for i in view.labelled)
        for view in (before, after)
    ]
    assert seen[0] == seen[1]
    assert len(seen[0]) == 6
    assert (before.depth_z_m == after.depth_z_m).all()


def test_labels_of_the_older_api_and_of_one_taxonomy_are_read(tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    (tmp_path / "old.usda").write_text(OLD)
    made = import_usd(tmp_path / "old.usda", tmp_path / "scene")
    assert made.labelled == 2
    assert made.losses == (
        "/World/Dog has several labels: the first was taken",
        "/World/Tree has labels of several taxonomies, none of them class",
    )
    view = open_scene(tmp_path / "scene", cache=False).view(size_wh=SIZE)
    assert [i.category for i in view.labelled] == ["car"]
    with pytest.raises(UsageError, match="already exists"):
        import_usd(tmp_path / "old.usda", tmp_path / "scene")
    (tmp_path / "bad.usda").write_text("nothing")
    with pytest.raises(LegoWorldError, match=r"USD cannot read bad\.usda"):
        import_usd(tmp_path / "bad.usda", tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_usd_needs_the_blend(scenes, tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    view = open_scene(scenes / "room", cache=False).view(size_wh=SIZE)
    with pytest.raises(UsageError, match=r"has no scene\.blend"):
        export([view], tmp_path / "out", format="usd")
    assert not (tmp_path / "out").exists()


def test_without_usd_core_the_extra_is_named(monkeypatch, tmp_path, scenes):
    monkeypatch.setattr("legoworld.scene.usd_labels.find_spec", lambda _: None)
    monkeypatch.setattr("legoworld.extras.requirements", lambda extra: [f"package-of-{extra}"])
    with pytest.raises(UsageError, match=r"found: no usd-core; .*next: .*package-of-usd"):
        export(scenes / "room", tmp_path / "out", format="usd", cache=False)
    assert not (tmp_path / "out").exists()
