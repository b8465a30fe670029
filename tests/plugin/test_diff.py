"""Every edit of a scene is named, and what only the window shows is none."""

from __future__ import annotations

import pytest
from plugin.rooms import ROOM_AND_EDITS

from legoworld.plugin.diff import changes

pytestmark = pytest.mark.blender

NAMED = {
    "moved": {("Cup", "transform")},
    "parent_moved": {("Crate", "transform"), ("Lid", "transform")},
    "vertex": {("Chair", "mesh")},
    "material_colour": {("Table", "material")},
    "material_swapped": {("Table", "material")},
    "lens": {("Camera", "data"), ("camera", "camera")},
    "camera_turned": {("Camera", "transform"), ("camera", "camera")},
    "hidden": {("Cup", "visibility")},
    "deleted": {("Chair", "removed")},
    "added": {("Vase", "added")},
    "renamed": {("Cup", "removed"), ("Mug", "added")},
    "modifier": {("Cup", "modifier")},
    "relabelled": {("Cup", "property")},
    "trait": {("Crate", "property")},
    "resolution": {("render", "render")},
    "world": {("world", "world")},
    "light": {("Lamp", "data")},
    "unparented": {("Lid", "parent")},
    "collected": {("Cup", "collection"), ("collections", "collection")},
}
UNSEEN = ("none", "node_moved_in_editor", "selected")
#: Same surfaces, camera and labels: what a readout of them says is the same, too.
NOT_GEOMETRY = ("material_colour", "material_swapped", "world", "light", "trait")


def test_every_edit_of_the_room_is_tested():
    edits = {line[9:].split("(")[0] for line in ROOM_AND_EDITS.splitlines() if "def edit_" in line}
    assert edits == {*NAMED, *UNSEEN}


@pytest.mark.parametrize("name", NAMED)
def test_an_edit_is_named_whole(live, name):
    before, after = live("none").state, live(name).state
    assert {(c.entity, c.kind) for c in changes(before, after)} == NAMED[name]
    assert before.scene_signature != after.scene_signature


@pytest.mark.parametrize("name", UNSEEN)
def test_what_only_the_window_shows_is_no_change(live, name):
    assert changes(live("none").state, live(name).state) == ()
    assert live("none").state == live(name).state


@pytest.mark.parametrize("name", NAMED)
def test_the_geometry_signature_is_the_readouts_own(live, name):
    same = live("none").state.geometry_signature == live(name).state.geometry_signature
    assert same == (name in NOT_GEOMETRY)


def test_undoing_is_the_edit_with_added_and_removed_swapped(live):
    swapped = {"added": "removed", "removed": "added"}
    for name in NAMED:
        there = changes(live("none").state, live(name).state)
        back = changes(live(name).state, live("none").state)
        assert {(c.entity, swapped.get(c.kind, c.kind)) for c in there} == {
            (c.entity, c.kind) for c in back
        }
