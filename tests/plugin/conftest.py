"""The room and its edits, built once."""

from __future__ import annotations

import pytest
from plugin.rooms import ROOM_AND_EDITS

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
