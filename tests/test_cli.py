"""The command line as a whole: help, examples, pages, exit codes, quick start."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest

from legoworld import cli

ROOT = Path(__file__).parents[1]
COMMANDS = cli.main.list_commands(click.Context(cli.main))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_and_examples(name, capsys):
    assert cli.run([name, "-h"]) == 0
    text = capsys.readouterr().out
    examples = [x for x in text.splitlines() if x.strip().startswith(f"legoworld {name}")]
    assert 2 <= len(examples) <= 4
    for option in re.findall(r"^  (-\S+.*)$", text, re.MULTILINE):
        assert "  " in option.strip(), f"no help for {option}"


def test_the_reference_page_is_what_the_commands_say():
    check = [sys.executable, str(ROOT / "docs" / "commands_page.py"), "--check"]
    assert subprocess.run(check, check=False).returncode == 0, "run `python docs/commands_page.py`"


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--help"], 0),
        (["--version"], 0),
        (["nonsense"], 2),
        (["readout"], 2),
        (["readout", "--task", "nonsense"], 2),
        (["inspect", "no/such/folder"], 2),
    ],
)
def test_exit_codes(arguments, code, capsys):
    assert cli.run(arguments) == code
    capsys.readouterr()


def test_a_folder_without_scenes_is_one_line(tmp_path, capsys):
    assert cli.run(["readout", str(tmp_path), "--task", "coco", "-o", str(tmp_path / "r")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "no scene.blend" in error


def test_list_schema_gives_an_author_everything_needed(capsys):
    assert cli.run(["list", "schema", "--task", "lvis", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert len(document["vocabulary"]) == 1203
    assert document["override_property"] == "lvis_category"
    assert document["schema_version"] == 1


@pytest.mark.parametrize("kind", ["tasks", "datasets", "baselines"])
def test_list(kind, capsys):
    assert cli.run(["list", kind, "--json"]) == 0
    names = [entry["name"] for entry in json.loads(capsys.readouterr().out)[kind]]
    if kind == "tasks":
        assert names == ["coco", "eth3d", "lvis"]
    if kind == "datasets":
        assert names == ["coco", "eth3d", "lvis", "skimage_examples"]


def test_help_imports_nothing_heavy():
    program = (
        "import sys; from legoworld.cli import run; run(['--help']);"
        "print([m for m in ('bpy', 'numpy', 'cv2', 'pycocotools', 'scipy', 'torch')"
        " if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stderr.strip() == "[]"


def test_the_main_process_never_imports_bpy():
    program = (
        "import sys, pkgutil, importlib, legoworld;"
        "[importlib.import_module(m.name)"
        " for m in pkgutil.walk_packages(legoworld.__path__, 'legoworld.')"
        " if '.blender.' not in m.name and not m.name.endswith(('__main__', '_kernel'))];"
        "print('bpy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"
