"""A scene that was frozen in one environment is read in another one, from another folder.

The author's Blender is a link to this one at another path, which is gone when the scenes are read.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scene.gltf.documents import png_of_alpha

from legoworld import cli
from legoworld.scene.cache import bpy_version

pytestmark = pytest.mark.blender

STARTUP = """
import bpy, os, sys
from pathlib import Path
OUT, SHIPPED = Path(sys.argv[-1]), Path(bpy.utils.system_resource("DATAFILES"))

def start():
    bpy.ops.wm.read_factory_settings()
    for thing in list(bpy.data.objects):  # as the authoring guide begins
        bpy.data.objects.remove(thing)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.location.z = 10
    scene.collection.objects.link(scene.camera)
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object["category"] = "dog"

def save(name):
    (OUT / name).mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / name / "scene.blend"), check_existing=False)

def text(font):
    made = bpy.data.objects.new("Text", bpy.data.curves.new("Text", "FONT"))
    made.data.body, made.data.font = "legoworld", font
    made["category"] = "book"
    bpy.context.scene.collection.objects.link(made)

start(); save("startup")
start(); bpy.ops.object.shade_auto_smooth(); save("smooth")
start(); text(bpy.data.fonts.load(str(SHIPPED / "fonts" / "DejaVuSansMono.woff2"))); save("font")
start()
essentials = SHIPPED / "assets" / "nodes" / "geometry_nodes_essentials.blend"
with bpy.data.libraries.load(str(essentials), link=True) as (_, wanted):
    wanted.node_groups = ["Smooth Geometry"]
bpy.context.object.modifiers.new("Nodes", "NODES").node_group = wanted.node_groups[0]
save("linked")
start()
library = Path.cwd() / "home" / "alice" / "library.blend"
library.parent.mkdir(parents=True)
bpy.data.libraries.write(str(library), {bpy.context.object.data})
with bpy.data.libraries.load(str(library), link=False) as (_, wanted):
    wanted.meshes = ["Cube"]
bpy.context.object.data = wanted.meshes[0]
save("appended")
start()
bpy.data.materials.new("Wood").use_nodes = True
bpy.context.object.data.materials.append(bpy.data.materials["Wood"])
node = bpy.data.materials["Wood"].node_tree.nodes.new("ShaderNodeTexImage")
node.image = bpy.data.images.new("wood", 2, 2)
node.image.source, node.image.filepath = "FILE", "/home/alice/wood.png"
save("missing")
"""
NAMES = ("appended", "font", "linked", "missing", "smooth", "startup")


READOUT = ["--task", "coco", "--require-frozen", "-q", "--workers", "1", "-o"]


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes built, frozen and read by the author, moved; Alice's home and her Blender are gone."""
    folder = tmp_path_factory.mktemp("portable")
    author, home = folder / "author", folder / "a" / "b" / "c" / "d" / "e" / "f"
    author.mkdir()
    home.mkdir(parents=True)
    spec = importlib.util.find_spec("bpy")
    assert spec is not None
    (author / "bpy").symlink_to(Path(str(spec.origin)).parent)
    environment = {**os.environ, "PYTHONPATH": str(author), "HOME": str(folder)}
    for command in (
        ["-c", STARTUP, "scenes"],
        ["-m", "legoworld", "freeze", "scenes", "--workers", "1"],
        ["-m", "legoworld", "readout", "scenes", *READOUT, str(folder / "authors")],
    ):
        done = subprocess.run(
            [sys.executable, *command], env=environment, capture_output=True, text=True,
            cwd=home, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr[-3000:]
    (author / "bpy").unlink()
    there = folder / "scenes"  # nearer to the root than relative paths from the author's lead
    (home / "scenes").rename(there)
    shutil.rmtree(folder / "a")
    return there


def rows_of(run: Path) -> dict[str, dict]:
    rows = map(json.loads, (run / "per_image.jsonl").read_text().splitlines())
    return {row["scene"]: row for row in rows}


def test_it_is_read_elsewhere_as_at_home(moved, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    run, authors = tmp_path / "run", moved.parent / "authors"
    code = cli.run(["readout", str(moved), *READOUT, str(run), "--no-cache"])
    found = {name: (row["status"], row["reason"]) for name, row in rows_of(run).items()}
    assert found == dict.fromkeys(NAMES, ("ok", None))
    assert code == 0
    for name in ("predictions.json", "per_image.jsonl"):
        assert (run / name).read_bytes() == (authors / name).read_bytes()


def test_no_path_of_a_machine_is_on_record(moved):
    for folder in (*(moved / name for name in NAMES), moved.parent / "authors"):
        for path in (p for p in folder.iterdir() if p.suffix in (".json", ".jsonl")):
            for word in ("alice/", "author/", "datafiles", str(moved.parent)):
                assert word not in path.read_text(), path


def test_what_ships_with_blender_is_recorded_by_version(moved):
    for name in NAMES:
        document = json.loads((moved / name / "frozen.json").read_text())
        assert document["bpy"] == bpy_version()
        assert [*document["dependencies"].values()] == ([None] if name == "missing" else [])


def test_a_missing_file_is_known_again_by_its_path(moved):
    (recorded,) = json.loads((moved / "missing" / "frozen.json").read_text())["dependencies"]
    assert recorded.startswith("outside://")
    assert recorded.endswith("/wood.png")


def test_a_record_that_carries_the_path_of_a_blender_is_read_with_a_warning(moved, tmp_path):
    """As `freeze` wrote it before: a file that no scene reads, by a path of the author's."""
    scene = tmp_path / "scenes" / "startup"
    shutil.copytree(moved / "startup", scene)
    document = json.loads((scene / "frozen.json").read_text())
    del document["covers"], document["bpy"]
    brushes = "5.0/datafiles/assets/brushes/essentials_brushes-gp_draw.blend"
    document["dependencies"] = {
        path: {"bytes": 7, "sha256": "0" * 64}
        for path in (f"/home/alice/bpy/{brushes}", f"../../../home/alice/bpy/{brushes}")
    }
    (scene / "frozen.json").write_text(json.dumps(document))
    run = tmp_path / "run"
    assert cli.run(["readout", str(scene.parent), *READOUT, str(run)]) == 0
    warnings = rows_of(run)["startup"]["warnings"]
    assert len(warnings) == 2
    assert all("essentials_brushes-gp_draw.blend, which scene.blend does" in w for w in warnings)
    assert "alice" not in (run / "per_image.jsonl").read_text()


@pytest.fixture
def outside(tmp_path, build_scenes):
    """A scene whose mask is a picture that it names by an absolute path."""
    picture = tmp_path / "alice" / "holes.png"
    picture.parent.mkdir()
    picture.write_bytes(png_of_alpha(np.full((2, 2), 255, np.uint8)))
    program = f"""
    fresh(); camera()
    material = bpy.data.materials.new("Leaf"); material.use_nodes = True
    image = material.node_tree.nodes.new("ShaderNodeTexImage")
    image.image = bpy.data.images.load({str(picture)!r})
    shader = material.node_tree.nodes["Principled BSDF"]
    material.node_tree.links.new(image.outputs["Alpha"], shader.inputs["Alpha"])
    quad("Leaf", category="potted plant").data.materials.append(material)
    (OUT / "leaf").mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(
        filepath=str(OUT / "leaf" / "scene.blend"), relative_remap=False, check_existing=False
    )
    """
    build_scenes(program, tmp_path / "scenes")
    return tmp_path / "scenes", picture


def test_a_file_outside_is_a_warning_of_freeze_and_part_of_the_scene(outside, tmp_path, capsys):
    scenes, picture = outside
    assert cli.run(["freeze", str(scenes), "--workers", "1"]) == 0
    assert "scene.blend reads holes.png from outside of the scenes" in capsys.readouterr().out
    assert "alice" not in (scenes / "leaf" / "frozen.json").read_text()
    run = tmp_path / "run"
    readout = ["readout", str(scenes), *READOUT, str(run)]
    assert cli.run(readout) == 0
    assert "alice" not in (run / "run.json").read_text()
    first = (run / "run.json").read_bytes()
    assert cli.run(readout) == 0
    assert (run / "run.json").read_bytes() == first
    picture.write_bytes(png_of_alpha(np.zeros((2, 2), np.uint8)))
    assert cli.run(readout) == 1
    assert rows_of(run)["leaf"]["status"] == "changed"
    picture.unlink()
    assert cli.run(readout) == 1
    assert rows_of(run)["leaf"]["status"] == "changed"
