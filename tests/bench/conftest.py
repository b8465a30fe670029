"""A reference scene with tiers and views, and submissions of every kind, built once."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from bench.stage import PROGRAM, picture

TRACK = {
    "info": {
        "description": "tests",
        "task": "bench",
        "card_version": "1.0.0",
        "picture": {
            "engine": "CYCLES", "device": "CPU", "samples": 4, "seed": 0, "denoised": False
        },
    },
    "images": [],
    "categories": [{"id": 1, "name": "box"}],
}  # fmt: skip

SUBMISSIONS = (
    PROGRAM
    + """
stage(); deliver("good")
stage(lens=40.0); deliver("narrow")
stage().camera = None; deliver("blind")
scene = stage(); scene.camera.data.type = "ORTHO"; deliver("flat_camera")
fresh(); camera(); save("empty")
stage(); bpy.data.objects["Red"].data.vertices[0].co.x = float("nan"); save("nan")
stage(); bpy.data.objects["Red"].name = "Other"; bpy.data.objects["Floor"].name = "Ground"
deliver("renamed")
import math
scene = stage()
image = bpy.data.images.new("photo", 32, 18); image.pixels = [1.0, 0.0, 0.0, 1.0] * (32 * 18)
image.pack()
card = mesh("Card", [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2, 3)])
card.parent = scene.camera; card.location = (0, 0, -2)
m = bpy.data.materials.new("Photo"); m.use_nodes = True
t = m.node_tree.nodes.new("ShaderNodeTexImage"); t.image = image
m.node_tree.links.new(t.outputs["Color"], m.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
card.data.materials.append(m)
bpy.data.texts.new("run.py").from_string("print(1)")
card["joint"] = {"type": "revolute", "axis": [0, 0, 1]}
deliver("cheat")
"""
)

REFERENCE = (
    PROGRAM
    + """
import math
scene = stage()
scene["environment"], scene["theme"] = "indoor", "shapes"
box("Green", 1.0, 0.5, 0.0, 0.5, category="box", tier="medium")
box("Blue", 0.0, -1.0, 0.0, 0.3, category="cube", tier="hard")
box("Quiet", 2.5, 1.5, 0.0, 0.4, category="box", scored=False)
first = scene.camera
first["view"] = 0
second = bpy.data.objects.new("Left", first.data.copy())
second["view"] = 1
second.location, second.rotation_euler = (-4.0, -5.0, 3.0), (math.radians(66), 0, math.radians(-38))
scene.collection.objects.link(second)
scene.camera = second
save("den")
"""
)

REFUSED = (
    PROGRAM
    + """
scene = stage(); del bpy.data.objects["Red"]["category"]; save("nothing_to_score")
scene = stage(); scene.camera.rotation_euler.x = 3.14
save("looks_away")
scene = stage(); bpy.data.objects["Red"]["tier"] = "medium"; save("no_hard")
scene = stage(); bpy.data.objects["Floor"]["tier"] = "hard"
red = bpy.data.objects["Red"]; red["tier"] = "medium"; red.parent = bpy.data.objects["Floor"]
save("part_before_whole")
scene = stage(); bpy.data.objects["Red"]["tier"] = "huge"; save("unknown_tier")
scene = stage(); scene.camera.data.type = "ORTHO"; save("orthographic")
scene = stage(); scene.camera.data.shift_x = 0.2; save("shifted")
stage().camera = None; save("no_camera")
stage(); save("good")
"""
)


@pytest.fixture(scope="session")
def submissions(build_scenes, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("submissions")
    build_scenes(SUBMISSIONS, folder)
    for scene in folder.iterdir():
        picture(scene / "final.png")
        if not (scene / "scene.glb").exists():
            shutil.copyfile(folder / "good" / "scene.glb", scene / "scene.glb")
    flat = folder / "flat_picture"
    shutil.copytree(folder / "good", flat)
    cv2.imwrite(str(flat / "final.png"), np.full((36, 64, 3), 128, np.uint8))
    bare = folder / "bare"
    bare.mkdir()
    shutil.copyfile(folder / "good" / "scene.blend", bare / "scene.blend")
    for name, data in (("damaged", b"BLENDER" + b"\0" * 400), ("not_a_glb", None)):
        shutil.copytree(folder / "good", folder / name)
        if data:
            (folder / name / "scene.blend").write_bytes(data)
    (folder / "not_a_glb" / "scene.glb").write_bytes(b"glTF")
    (folder / "nothing").mkdir()
    return folder


@pytest.fixture(scope="session")
def track_for():
    """A bench track of these images at 64 x 36, as a file."""

    def write(path: Path, names: list[str], hfov_deg: float = 61.927513064147) -> Path:
        images = [
            {
                "id": number, "file_name": f"{name}.png", "width": 64, "height": 36,
                "hfov_deg": hfov_deg, "family": name, "environment": None, "theme": None,
                "split": None, "tier": None, "view": 0,
            }
            for number, name in enumerate(names, start=1)
        ]  # fmt: skip
        path.write_text(json.dumps({**TRACK, "images": images}), encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def references(build_scenes, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("references")
    build_scenes(REFERENCE, folder)
    return folder


@pytest.fixture(scope="session")
def refused(build_scenes, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("refused")
    build_scenes(REFUSED, folder)
    return folder
