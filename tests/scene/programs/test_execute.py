"""`legoworld execute`: whole programs, stopped ones, ones that build nothing, ones that hang."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path

import pytest
from scene.programs.executed import BUILD, execute, execution

from legoworld import cli, exit_codes
from legoworld.files import sha256_of_file
from legoworld.scene.programs.verdicts import ended_early, over_limit
from legoworld.scene.side_files import program_warnings
from legoworld.workers.sandbox import Ending, SandboxLimits

pytestmark = pytest.mark.blender

TAKES_ITS_REPORT_AWAY = """\
import json, os, shutil, sys
report = json.loads(sys.orig_argv[-1])["report"]
os.unlink(report)
"""


def test_a_whole_program_becomes_a_scene_that_reads_out(tmp_path, capsys):
    code, output = execute(tmp_path, BUILD, quiet=False)
    assert code == 0
    steps = capsys.readouterr().err.splitlines()
    assert [line for line in steps if "warning" not in line] == [
        "running program.py", "rendering final.png"
    ]  # fmt: skip
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


def test_a_stopped_program_is_a_warning_all_the_way(tmp_path, capsys):
    """freeze, inspect, readout and its rows, which the report shows; for that scene.blend only."""
    program = BUILD + "raise ValueError('half way')\n"
    _, output = execute(tmp_path, program, "--no-picture")
    line = len(program.splitlines())
    words = f"the program that built the scene stopped at line {line} (ValueError)"
    capsys.readouterr()
    assert cli.run(["freeze", str(output)]) == 0
    assert words in capsys.readouterr().out
    assert cli.run(["inspect", str(output), "--json"]) == 0
    assert any(words in w for w in json.loads(capsys.readouterr().out)["warnings"])
    run = tmp_path / "run"
    assert cli.run(["readout", str(tmp_path), "--task", "coco", "-o", str(run), "-q"]) == 0
    row = json.loads((run / "per_image.jsonl").read_text().splitlines()[0])
    assert row["status"] == "ok"
    assert any(words in w for w in row["warnings"])
    marked = execution(output)
    marked["files"]["scene.blend"] = "0" * 64  # of another scene.blend
    (output / "execution.json").write_text(json.dumps(marked))
    assert program_warnings(output, sha256_of_file(output / "scene.blend")) == ()
    (output / "execution.json").write_text("[" * 100)
    assert "execution.json cannot be used" in program_warnings(output, "0" * 64)[0]


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


@pytest.mark.parametrize(
    ("program", "options", "words"),
    [
        (
            "while True: pass\n",
            ("--time-limit", "3"),
            ("the program did not", "after 3 s", "raise --time-limit"),
        ),
        (
            "import ctypes\n\nctypes.string_at(0)\n",
            (),
            ("the program crashed in Blender", "SIGSEGV, at line 3", "change what the program"),
        ),
        (
            "import os\nprint('enough')\nos._exit(7)\n",
            (),
            ("the program ended its process", "exit code 7; its last line: enough", "os._exit"),
        ),
        (
            "import os\nos._exit(139)\n",
            (),
            ("the program ended its process", "exit code 139; its last line: no message"),
        ),
        (
            TAKES_ITS_REPORT_AWAY + "os._exit(3)\n",
            (),
            ("the program ended its process", "exit code 3, and its report is gone;"),
        ),
        (
            TAKES_ITS_REPORT_AWAY + "import ctypes\nctypes.string_at(0)\n",
            (),
            ("the program crashed in Blender", "SIGSEGV, at line"),
        ),
        (
            "import time\nheld = bytearray(b'x') * (1100 << 20)\ntime.sleep(600)\n",
            ("--memory-limit", "1"),
            ("used too much memory", "more than 1 GiB", "raise --memory-limit"),
        ),
    ],
    ids=["hangs", "crashes", "leaves", "leaves like a crash", "takes its report and leaves",
         "takes its report and crashes", "grows"],
)  # fmt: skip
def test_what_a_program_did_is_said_of_the_program(tmp_path, capsys, program, options, words):
    """Not of a scene: nothing was built yet that could be damaged or simplified."""
    code, output = execute(tmp_path, program, *options)
    assert code == 2
    said = capsys.readouterr().err
    for word in words:
        assert word in said
    assert list(output.iterdir()) == []


def test_a_program_that_takes_its_report_away_and_hangs_is_said_with_its_line(tmp_path, capsys):
    program = TAKES_ITS_REPORT_AWAY + "shutil.rmtree(os.path.dirname(report))\nwhile True: pass\n"
    for seconds in (4, 30, 120):  # within the first, a busy machine has not started Blender
        code, output = execute(tmp_path, program, "--time-limit", str(seconds))
        assert code == 2
        assert list(output.iterdir()) == []
        said = capsys.readouterr().err
        if "at line 5" in said:
            break
    assert "the program did not finish" in said
    assert f"still running after {seconds} s, at line 5" in said


def test_the_line_that_hangs_or_crashes_is_the_programs_own():
    """faulthandler's stack, innermost first: Blender's own files and the program's."""
    stack = (
        "Timeout (0:00:03)!\nThread 0x7f (most recent call first):\n"
        '  File "/bpy/ops.py", line 109 in __call__\n  File "/p/scene.py", line 12 in add\n'
        '  File "/p/scene.py", line 40 in <module>\n'
    )
    limits = SandboxLimits(time_s=3.0, memory_bytes=1 << 30)
    ending = Ending(code=None, over="time", first_output="", last_output="built 3\n" + stack)
    error = over_limit(ending, "time", "program", limits, Path("/p/scene.py"))
    assert error.found == "still running after 3 s, at line 12"
    assert (error.status, error.code) == ("timeout", "program_timeout")
    error = over_limit(ending, "time", None, limits, Path("/p/scene.py"))
    assert "Blender was still starting" in error.found
    crash = "built 3\nFatal Python error: Segmentation fault\n\nCurrent t" + stack[18:]
    ending = Ending(code=-11, over=None, first_output="", last_output=crash)
    error = ended_early(ending, "program", Path("/p/scene.py"))
    assert error.found == "SIGSEGV, at line 12; its last line: built 3"
    assert "while its scene was exported" in ended_early(ending, "export", Path("/p/s.py")).what
    assert ended_early(ending, None, Path("/p/s.py")).code == "blender_not_started"


def test_a_program_that_exits_by_itself_says_with_what(tmp_path, capsys):
    program = BUILD + "import sys\nsys.exit(3)\n"
    code, output = execute(tmp_path, program, "--no-picture")
    assert code == 1
    assert execution(output)["error"] == {
        "type": "SystemExit 3",
        "message": "the program ended itself with exit code 3",
        "line": len(program.splitlines()),
    }


def test_a_scene_without_a_camera_is_whole_and_says_what_it_lacks(tmp_path):
    program = BUILD.replace("bpy.context.scene.camera = camera\n", "")
    code, output = execute(tmp_path, program)
    assert code == exit_codes.NOT_ASSESSED
    made = execution(output)
    assert made["check"]["code"] == "no_camera"
    assert made["status"] == "complete"
    assert len(made["warnings"]) == 1
    assert "no active camera" in made["warnings"][0]
    assert "foreseen" not in json.dumps(made)


def test_a_program_runs_in_an_empty_folder_and_leaves_no_trace_there(tmp_path):
    program = BUILD + "import os\nassert os.listdir('.') == [], os.listdir('.')\nopen('x', 'w')\n"
    code, output = execute(tmp_path, program, "--no-picture")
    assert code == 0, execution(output)["error"]
    assert not list(tmp_path.rglob("x"))


@pytest.mark.real_data
def test_real_programs_end_as_recorded(real_data, tmp_path):
    """A scene without a camera, a program that stops at its save line, one without a scene."""
    folder = real_data / "programs" / "gtvibeathon"
    for name, status in [
        ("complete_combined_script_2008a6.py", "complete"),
        ("create_house_f63185.py", "stopped"),
        ("force_complete_9173b3.py", None),
    ]:
        output = tmp_path / name
        code = cli.run(["execute", str(folder / name), "-o", str(output), "-q", "--no-picture"])
        assert code == {"complete": 5, "stopped": 1, None: 2}[status]
        assert (output / "scene.blend").is_file() == (status is not None)
        if status:
            assert execution(output)["status"] == status
