"""The room and its edits, built once."""

from __future__ import annotations

import shutil

import pytest
from endpoint.clients import serve_session
from plugin.live_room import reopen_case
from plugin.rooms import ROOM_AND_EDITS

from legoworld.plugin.connection import Address, BlenderConnection
from legoworld.plugin.state import read_live
from legoworld.scene.blender_process import BlenderProcess, Limits


@pytest.fixture(scope="session")
def room_folders(tmp_path_factory, build_scenes):
    folder = tmp_path_factory.mktemp("rooms")
    build_scenes(ROOM_AND_EDITS, folder)
    return folder


@pytest.fixture(scope="session")
def blender():
    with BlenderProcess(Limits()) as process:
        yield process


@pytest.fixture(scope="session")
def live(room_folders, blender):
    """The state of an edit of the room, by its name; "none" is the room itself."""
    known = {}

    def read(name):
        if name not in known:
            known[name] = read_live(room_folders / name / "scene.blend", blender)
        return known[name]

    return read


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory, room_folders):
    """A Blender with the room, saved in its own workspace."""
    with serve_session(tmp_path_factory.mktemp("endpoint")) as found:
        shutil.copy(room_folders / "none" / "scene.blend", found.workspace / "room.blend")
        yield found


@pytest.fixture
def blender_code(endpoint):
    """Runs code in the live scene, which is the room anew for every test."""
    live = BlenderConnection(Address(port=endpoint.server.port))
    path = str(endpoint.workspace / "room.blend")
    live.run(f"import bpy; bpy.ops.wm.open_mainfile(filepath={path!r})")
    return live


@pytest.fixture
def case(tmp_path, blender_code, blender):
    return reopen_case(tmp_path, blender_code, blender)
