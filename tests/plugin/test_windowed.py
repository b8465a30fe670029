"""The plugin over mcp-for-blender's own add-on, in a Blender that has a window."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest
from agents.tracks import steps_file
from plugin.guarded import check_scene
from plugin.synthetic import SIZE, camera, evidence_with, region_of, room, seen_faces
from plugin.windowed import windowed_blender

from legoworld.agents.mcp_server import PLAYER, blender_server, server_python, write_configuration
from legoworld.files import sha256_of_file
from legoworld.plugin.case import STATES, Case
from legoworld.plugin.connection import Address, BlenderConnection, BlenderRefusedError
from legoworld.plugin.initial_room import install_room
from legoworld.plugin.initialisation import recover
from legoworld.plugin.live import LiveBlender
from legoworld.records import plugin_requirements as kinds
from legoworld.records.agents import AgentMcp
from legoworld.records.plugin_ledger import Declaration, TransactionLimits
from legoworld.scene.cache import bpy_version

pytestmark = pytest.mark.blender

#: The cube of a new scene between a floor and a cup, saved as a file of the user's.
BUILD = """
import bpy, os
def box(name, low, high):
    (x, y, z), (X, Y, Z) = low, high
    corners = [(u, v, w) for w in (z, Z) for u, v in ((x, y), (X, y), (X, Y), (x, Y))]
    faces = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    data = bpy.data.meshes.new(name)
    data.from_pydata(corners, [], faces)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, data))
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=False)
box("Floor", (-3, -3, -1.1), (3, 3, -1))
box("Cup", (0.2, -0.6, 1), (0.6, -0.2, 1.5))
bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 320, 240
bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath("room.blend"), check_existing=False)
"""
EMPTY = "import bpy\nbpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)"
OPEN = "import bpy\nprint(bpy.data.filepath, len(bpy.context.window_manager.windows))"


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    with windowed_blender(tmp_path_factory.mktemp("window")) as found:
        assert found.windows == 1
        yield found


@pytest.fixture
def connection(window, blender, tmp_path):
    """The room, open in the window. A Blender newer than the reader is refused, and that is all."""
    found = BlenderConnection(Address(port=window.port))
    found.run(BUILD)
    newest = tuple(map(int, bpy_version().split(".")[:2]))
    if window.version > newest:
        with pytest.raises(BlenderRefusedError, match="newer than the one that reads"):
            LiveBlender(found, blender, tmp_path).read()
        pytest.skip(f"Blender {window.version} is newer than the reader, and was refused as such")
    return found


def case_of(folder, connection, blender, evidence=None):
    (folder / STATES).mkdir()
    live = LiveBlender(connection, blender, folder / STATES)
    return Case(folder, live, evidence, TransactionLimits())


def test_edits_are_measured_and_guarded(window, connection, blender, tmp_path):
    saved = window.folder / "room.blend"
    before = sha256_of_file(saved)
    check_scene(saved, tmp_path, connection, blender)
    assert connection.run(OPEN).split() == [str(saved), "1"]
    assert sha256_of_file(saved) == before, "four rollbacks later it is the user's file still"


def test_a_room_and_its_camera_are_installed(connection, blender, tmp_path):
    random = np.random.default_rng(5)
    world_from_cam, place = camera(random)
    faces = seen_faces(room(random), world_from_cam, place, 70)
    masks = {"wall": (faces >= 0) & (faces < 4), "floor": faces == 4, "ceiling": faces == 5}
    regions = [region_of(name, mask) for name, mask in masks.items()]
    photo = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    evidence = evidence_with(regions, world_from_cam, 70, photo=photo)
    connection.run(EMPTY)
    case = case_of(tmp_path, connection, blender, evidence)
    install_room(case, recover(evidence, None, 1.6))
    assert [e.tool for e in case.ledger.entries] == ["begin", "initialize", "commit"]
    assert case.phase == "idle"


def play_code(folder, port, code):
    """Run code in the window as an agent does: by the MCP server that it starts."""
    folder.mkdir()
    write_configuration(
        folder / "mcp.json",
        AgentMcp(format="mcp_servers", path="mcp.json"),
        [blender_server(port, folder)],
    )
    steps_file(folder / "steps.jsonl", [code])
    (folder / "prompt.md").write_text("Edit it.")
    command = [str(server_python()), str(PLAYER), "--mcp-config", str(folder / "mcp.json")]
    command += ["--steps", str(folder / "steps.jsonl"), "--prompt", str(folder / "prompt.md")]
    command += ["--transcript", str(folder / "transcript.json")]
    subprocess.run(command, check=True, cwd=folder, timeout=600)
    return json.loads((folder / "transcript.json").read_text())["steps"][-1]


def test_an_agent_s_edits_through_mcp_for_blender(window, connection, blender, tmp_path):
    case = case_of(tmp_path, connection, blender)
    declared = Declaration(
        editable=("Cup",),
        kinds=("transform",),
        requirements=(kinds.Support(entity="Cup", on="Cube"),),
    )
    case.begin(declared)
    play_code(
        tmp_path / "good", window.port, "import bpy\nbpy.data.objects['Cup'].location.x -= 0.2"
    )
    assert case.commit()[0].accepted
    begun = case.begin(declared)
    play_code(tmp_path / "bad", window.port, "import bpy\nbpy.data.objects['Cup'].location.z += 1")
    judgement, report = case.commit()
    assert judgement.blocked
    assert [result.verdict for result in report.results] == ["fail"]
    assert case.rollback().scene_signature == begun.scene_signature
