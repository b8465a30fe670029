"""Every kind of edit is named; what a window, a render or saving does is none."""

from __future__ import annotations

import json

import pytest
from plugin.every_edit import EDITS, NO_EDITS, SCENE_AND_EDITS

from legoworld.plugin.diff import changes
from legoworld.plugin.state import read_live

pytestmark = pytest.mark.blender


@pytest.fixture(scope="module")
def state(tmp_path_factory, build_scenes, blender):
    folder = tmp_path_factory.mktemp("edits")
    codes = {name: code for name, (_, code) in EDITS.items()} | NO_EDITS
    build_scenes(f"EDITS = {json.dumps(codes)!r}\n{SCENE_AND_EDITS}", folder)

    def read(name):
        return read_live(folder / name / "scene.blend", blender).state

    return read


@pytest.fixture(scope="module")
def start(state):
    return state("start")


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_is_named(start, state, name):
    entity, _ = EDITS[name]
    assert entity in {change.entity for change in changes(start, state(name))}


@pytest.mark.parametrize("name", NO_EDITS)
def test_what_is_no_edit_is_not_named(start, state, name):
    assert changes(start, state(name)) == ()
    assert start == state(name)


def test_there_are_edits_of_every_kind():
    assert len(EDITS) >= 100
