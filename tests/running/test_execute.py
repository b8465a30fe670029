"""`legoworld execute`: whole programs, stopped ones, ones that build nothing, ones that hang."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path

import pytest

from legoworld import cli

pytestmark = pytest.mark.blender

BUILD = """
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_cube_add(size=2)
bpy.context.object["category"] = "dog"
bpy.context.object.data.materials.append(bpy.data.materials.new("Grey"))
camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
camera.location.z = 8
bpy.context.scene.collection.objects.link(camera)
bpy.context.scene.camera = camera
bpy.context.scene.render.resolution_x = 48
bpy.context.scene.render.resolution_y = 32
light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "SUN"))
bpy.context.scene.collection.objects.link(light)
"""


def execute(tmp_path: Path, program: str, *options: str) -> tuple[int, Path]:
    path = tmp_path / "program.py"
    path.write_text(textwrap.dedent(program))
    output = tmp_path / "scene"
    return cli.run(["execute", str(path), "-o", str(output), "-q", *options]), output


def execution(output: Path) -> dict:
    return json.loads((output / "execution.json").read_text())


def test_a_whole_program_becomes_a_scene_that_reads_out(tmp_path):
    code, output = execute(tmp_path, BUILD)
    assert code == 0
    names = {p.name for p in output.iterdir()}
    assert names == {"scene.blend", "scene.glb", "final.png", "scene.py", "execution.json"}
    assert execution(output)["status"] == "complete"
    assert (output / "scene.py").read_text() == BUILD
    assert str(tmp_path).encode() not in (output / "final.png").read_bytes()
    assert b"Date" not in (output / "final.png").read_bytes()
    assert cli.run(["freeze", str(output), "-q"]) == 0
    run = tmp_path / "run"
    assert cli.run(["readout", str(tmp_path), "--task", "coco", "-o", str(run), "-q"]) == 0
    predictions = json.loads((run / "predictions.json").read_text())
    assert [p["category_id"] for p in predictions] == [18]


def test_a_program_that_dies_at_its_save_line_is_exported_and_marked(tmp_path, capsys):
    program = BUILD + "bpy.ops.wm.save_as_mainfile(filepath='/no/such/folder/scene.blend')\n"
    code, output = execute(tmp_path, program, "--no-picture")
    assert code == 1
    marked = execution(output)
    assert marked["status"] == "stopped"
    assert marked["error"]["line"] == len(program.splitlines())
    assert marked["error"]["type"] == "RuntimeError"
    assert (output / "scene.blend").is_file()
    assert f"line {marked['error']['line']}: RuntimeError" in capsys.readouterr().out


def test_a_removed_api_names_its_line_inside_a_function(tmp_path):
    program = BUILD + textwrap.dedent("""
        def paint():
            material = bpy.data.materials["Grey"]
            material.no_such_attribute.value = 1

        paint()
        """)
    code, output = execute(tmp_path, program, "--no-picture")
    assert code == 1
    line = program.splitlines()[execution(output)["error"]["line"] - 1]
    assert "no_such_attribute" in line


def test_its_own_render_and_quit_calls_do_not_matter(tmp_path):
    program = BUILD + "bpy.ops.render.render(write_still=True)\nbpy.ops.wm.quit_blender()\n1 / 0\n"
    code, output = execute(tmp_path, program, "--no-picture")
    assert code == 0
    assert any("render calls were skipped" in w for w in execution(output)["warnings"])


@pytest.mark.parametrize(
    "program",
    ["import bpy\n", "import sys\nsys.exit(1)\n", "def broken(:\n", "raise ValueError('early')\n"],
)
def test_a_program_that_builds_nothing_leaves_nothing(tmp_path, program, capsys):
    code, output = execute(tmp_path, program)
    assert code == 2
    assert "built nothing" in capsys.readouterr().err
    assert list(output.iterdir()) == []


def test_a_program_that_hangs_or_kills_its_process_is_a_verdict(tmp_path, capsys):
    code, _ = execute(tmp_path, "while True: pass\n", "--time-limit", "3")
    assert code == 2
    assert "no answer after 3 s" in capsys.readouterr().err
    code, _ = execute(tmp_path, "import os\nos.abort()\n")
    assert code == 2
    assert "signal 6" in capsys.readouterr().err


def test_a_program_runs_in_an_empty_folder_and_leaves_no_trace_there(tmp_path):
    program = BUILD + "import os\nassert os.listdir('.') == [], os.listdir('.')\nopen('x', 'w')\n"
    code, output = execute(tmp_path, program, "--no-picture")
    assert code == 0, execution(output)["error"]
    assert not list(tmp_path.rglob("x"))


@pytest.mark.real_data
def test_real_programs_end_as_recorded(real_data, tmp_path):
    """A program, one that stops at its save line, and one that builds nothing."""
    folder = real_data / "programs" / "gtvibeathon"
    for name, status in [
        ("complete_combined_script_2008a6.py", "complete"),
        ("create_house_f63185.py", "stopped"),
        ("force_complete_9173b3.py", None),
    ]:
        output = tmp_path / name
        code = cli.run(["execute", str(folder / name), "-o", str(output), "-q", "--no-picture"])
        assert code == (0 if status == "complete" else 1)
        assert (output / "scene.blend").is_file() == (status is not None)
        if status:
            assert execution(output)["status"] == status
