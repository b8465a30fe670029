"""`legoworld execute` against programs that lie, overwrite and run away."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from scene.programs.executed import BUILD, execute, execution
from waiting import until
from workers.confinements import bubblewrap_or_skip

from legoworld.records.scene_folder import ProgramReport, Reason
from legoworld.scene.programs.execution import _hints
from legoworld.scene.programs.report import read_report

pytestmark = pytest.mark.blender


OVERWRITE = """
import atexit, os, pathlib, sys, threading
output = pathlib.Path(__import__("json").loads(sys.orig_argv[-1])["output"])
real_exit = os._exit
def spoil(code):
    {what}
    real_exit(code)
os._exit = spoil
"""


@pytest.mark.parametrize(
    ("what", "found"),
    [
        ("(output / 'scene.blend').write_text('not a blend')", "scene.blend"),
        ("(output / 'scene.blend').unlink()", "no such file"),
        (
            "(output / 'scene.blend').unlink();(output / 'scene.blend').symlink_to('/usr/bin/env')",
            "a link",
        ),
        ("import shutil; shutil.rmtree(output); output.symlink_to('/usr')", "folder"),
    ],
    ids=["text", "nothing", "a link", "a linked folder"],
)
def test_a_program_that_replaces_its_outputs_is_refused(tmp_path, capsys, confinement, what, found):
    program = OVERWRITE.format(what=what) + BUILD
    code, output = execute(tmp_path, program, "--no-picture", "--sandbox", confinement)
    assert code == 2
    said = capsys.readouterr().err
    assert "the program" in said
    assert found in said or "ended its process" in said
    assert list(output.iterdir()) == []


def test_a_glb_that_is_none_is_not_delivered(tmp_path, confinement):
    program = OVERWRITE.format(what="(output / 'scene.glb').write_text('no glb')") + BUILD
    code, output = execute(tmp_path, program, "--no-picture", "--sandbox", confinement)
    assert code == 0
    assert not (output / "scene.glb").exists()
    assert "scene.glb is not delivered" in execution(output)["warnings"][0]


def test_a_program_cannot_answer_for_the_reader(tmp_path, capsys, confinement):
    """All descriptors there are, and the report, say that all is well: there is no scene."""
    forged = json.dumps({"ok": True, "error": None, "skipped": [], "warnings": []})
    program = f"""
import json, os, sys
request = json.loads(sys.orig_argv[-1])
open(request["report"], "w").write({forged!r})
for n in range(3, 256):
    try:
        os.write(n, {forged!r}.encode() + b"\\n")
    except OSError:
        pass
os._exit(0)
"""
    code, output = execute(tmp_path, program, "--sandbox", confinement)
    assert code == 2
    assert "the program replaced its own scene.blend; found: no such file" in (
        capsys.readouterr().err
    )
    assert list(output.iterdir()) == []


def test_a_fork_that_comes_to_the_same_end_exports_nothing(tmp_path, confinement):
    program = BUILD + "import os\nos.fork()\n"
    code, output = execute(tmp_path, program, "--no-picture", "--sandbox", confinement)
    assert code == 0
    assert execution(output)["status"] == "complete"


def test_the_program_that_is_recorded_is_the_one_that_ran(tmp_path):
    program = BUILD + "open(__file__, 'w').write('import nothing')\n"
    code, output = execute(tmp_path, program, "--no-picture", "--sandbox", "limits")
    assert code == 0
    assert (output / "scene.py").read_text() == program


def test_bubblewrap_keeps_a_program_from_its_callers_files(tmp_path):
    bubblewrap_or_skip()
    (tmp_path / "wood.txt").write_text("grain")
    program = BUILD + f"open({str(tmp_path / 'wood.txt')!r}).read()\n"
    code, output = execute(tmp_path, program, "--no-picture", "--sandbox", "bubblewrap")
    assert code == 1
    assert execution(output)["error"]["type"] == "FileNotFoundError"
    assert any("--input" in warning for warning in execution(output)["warnings"])
    assert "files" in execution(output)["sandbox"]["holds"]
    options = ("--no-picture", "--sandbox", "bubblewrap", "--input", str(tmp_path / "wood.txt"))
    code, output = execute(tmp_path, program, *options)
    assert code == 0


@pytest.mark.parametrize(
    ("reads", "named"),
    [
        ("bpy.data.images.load({there!r})", "there.png"),  # a RuntimeError of Blender's
        ("import beside", "beside.py"),
        ("open({there!r} + '.not')", None),  # it is nowhere: no --input would help
        ("open('a\\0b')", None),
    ],
)
def test_a_hint_names_what_bubblewrap_did_not_show_and_nothing_else(tmp_path, reads, named):
    bubblewrap_or_skip()
    (tmp_path / "there.png").write_bytes(b"no picture, but a file")
    (tmp_path / "beside.py").write_text("")
    program = BUILD + reads.format(there=str(tmp_path / "there.png")) + "\n"
    code, output = execute(tmp_path, program, "--no-picture", "--sandbox", "bubblewrap")
    assert code == 1
    hints = [word for word in execution(output)["warnings"] if "--input" in word]
    assert [word.endswith(f"--input {tmp_path}/{named}") for word in hints] == [True] * bool(named)


def test_a_hint_names_the_file_that_a_relative_path_meant_and_a_module_that_is_nowhere(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.png").write_bytes(b"no picture, but a file")
    silent = "import cv2\ncv2.imread('there.png').shape\n"  # the error names no file, cv2 does
    for reads in ("open('there.png')\n", silent):
        code, output = execute(tmp_path, BUILD + reads, "--no-picture", "--sandbox", "limits")
        assert code == 1
        (hint,) = execution(output)["warnings"]
        path = tmp_path / "there.png"
        assert hint == f"the program runs in an empty folder: read there.png as {path}"
    _, output = execute(tmp_path, BUILD + "import nowhere.near\n", "--no-picture")
    assert execution(output)["warnings"] == [
        "nowhere is not in Blender's Python, which runs the program"
    ]
    program = tmp_path / "program.py"
    alone = _hints("'there.png'", "", program, [], shown_alone=True)
    assert alone[0].startswith(f"the program runs in an empty folder: pass --input {path} and read")
    assert _hints("'there.png'", "", program, [path], shown_alone=True) == [hint]


def test_escape_sequences_in_an_error_do_not_reach_the_terminal(tmp_path, capsys):
    program = BUILD + "raise ValueError('\\x1b]0;owned\\x07 \\x9b31m \\u202e \\udc80')\n"
    code, output = execute(tmp_path, program, "--no-picture")
    assert code == 1
    said = capsys.readouterr().out
    assert "ValueError" in said
    assert not set(said) & set("\x1b\x07\x9b\u202e\udc80")
    assert "\\u001b" not in (output / "execution.json").read_text()


def test_killed_while_it_runs_nothing_is_left(tmp_path, confinement):
    """kill -9 of the command: its program and its folder go with it."""
    (tmp_path / "program.py").write_text("import time\nopen('begun', 'w')\ntime.sleep(600)\n")
    output = tmp_path / "scene"
    with subprocess.Popen(
        [
            sys.executable, "-m", "legoworld", "execute", str(tmp_path / "program.py"),
            "-o", str(output), "--sandbox", confinement,
        ],
        env={**os.environ, "TMPDIR": str(tmp_path)},
    ) as command:  # fmt: skip
        until(lambda: list(output.glob(".executing-*/sandbox/empty/begun")))
        command.kill()
    until(lambda: list(output.iterdir()) == [])


@pytest.mark.parametrize(
    "text",
    ["", "[", "[]", "null", '{"ok": 1}', "[" * 100000, '{"ok": true, "error": {"line": "x"}}',
     '{"at": 5}', '{"ok": false, "reason": 3}', '{"ok": true, "warnings": {"a": 1}}'],
)  # fmt: skip
def test_a_report_of_any_content_is_understood(tmp_path, text):
    path = tmp_path / "report.json"
    path.write_text(text)
    report = read_report(path)
    assert report == ProgramReport(at="program")


def test_a_report_is_read_as_single_lines(tmp_path):
    path = tmp_path / "report.json"
    path.write_text('{"ok": false, "reason": {"code": "export", "found": "a\\nb\\u202e"}, '
                    '"warnings": ["c\\td"]}')  # fmt: skip
    assert read_report(path) == ProgramReport(
        at="export", ok=False, reason=Reason(code="export", found="a b\ufffd"), warnings=("c d",)
    )
