"""`blender mcp` is a whole MCP server; `blender finalise` exports what was built through it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from agents.tracks import SMALL, server_or_skip, steps_file

from legoworld import cli
from legoworld.agents.mcp_server import PLAYER, server_python

pytestmark = pytest.mark.blender

ROOT = Path(__file__).parents[2]
CUBE = f"import bpy\n{SMALL}\nbpy.ops.mesh.primitive_cube_add(location=(0, 3, 0))"
SAVE = "import bpy, os\nbpy.ops.wm.save_as_mainfile(filepath=os.getcwd() + '/scene.blend')"
SPOIL = "open('scene.blend', 'w').write('spoiled')"


def play_steps(folder: Path, codes: list[str]) -> list[str]:
    """What each step came back with, from a real MCP client that starts the command itself."""
    steps_file(folder / "steps.jsonl", codes)
    command = ["-m", "legoworld", "blender", "mcp", "--workspace", str(folder / "work"), "-q"]
    # A client hands on little of its own environment: where mcp-for-blender is has to be said.
    environment = {k: v for k, v in os.environ.items() if k == "XDG_DATA_HOME"}
    environment["PYTHONPATH"] = str(ROOT)
    server = {"command": sys.executable, "args": command, "env": environment}
    (folder / "mcp.json").write_text(json.dumps({"mcpServers": {"blender": server}}))
    (folder / "prompt.md").write_text("Build it.")
    transcript = folder / "transcript.json"
    subprocess.run(
        [
            *(str(server_python()), str(PLAYER), "--mcp-config", str(folder / "mcp.json")),
            *("--steps", str(folder / "steps.jsonl"), "--prompt", str(folder / "prompt.md")),
            *("--transcript", str(transcript)),
        ],
        check=True,
        cwd=folder,
    )
    steps = json.loads(transcript.read_text())["steps"]
    return [s["observation"]["results"][0]["content"] for s in steps if s["source"] == "agent"]


def test_an_agent_starts_it_and_what_it_built_is_finalised(tmp_path, capsys):
    server_or_skip()
    said = play_steps(tmp_path, [CUBE, SAVE, SPOIL, "print(len(bpy.data.objects))"])
    assert said[-1].strip().endswith("4")
    again = play_steps(tmp_path, ["print(len(bpy.data.objects))"])
    assert again[-1].strip().endswith("4"), "the same workspace continues with its last scene"
    work, out = str(tmp_path / "work"), tmp_path / "out"
    assert cli.run(["blender", "finalise", work, "-o", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["finalisation"]
    assert found["source"] == "saved"
    assert len(found["refused"]) == 1, "the spoiled file is not taken"
    assert {path.name for path in out.iterdir()} >= {"scene.blend", "scene.glb", "final.png"}
    assert cli.run(["blender", "finalise", work, "-o", str(out)]) == 2, "never over what is there"


def test_an_empty_workspace_has_no_scene(tmp_path, capsys):
    (tmp_path / "work").mkdir()
    assert cli.run(["blender", "finalise", str(tmp_path / "work"), "-o", str(tmp_path / "o")]) == 1
    assert "no scene" in capsys.readouterr().err
