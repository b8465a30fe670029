"""Rows 33 and 34 of the readout cases: files that would act, and files that lack something."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from legoworld.errors import MissingLibraryError, UnreadableBlendError

pytestmark = pytest.mark.blender


def test_row_33_nothing_in_a_file_is_run(cases):
    case = cases.read("registered_text")
    assert case.area("Plane") == 400
    assert len(case.expected) == 3
    assert [target for target in case.expected if Path(target).exists()] == []


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9])
def test_row_34_a_truncated_file_is_a_failed_scene_and_not_an_empty_one(cases, share):
    whole = (cases.folder / "a_small_quad" / "scene.blend").read_bytes()
    folder = cases.folder / f"truncated_{share}"
    folder.mkdir(exist_ok=True)
    (folder / "scene.blend").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(UnreadableBlendError) as caught:
        cases.read(folder.name)
    assert caught.value.found
    assert str(cases.folder) not in str(caught.value)


def test_row_34_a_missing_texture_changes_no_geometry_and_is_on_record(cases):
    case = cases.read("missing_texture")
    assert case.area("Plane") == 400
    assert case.scene.files.dependencies == {"textures/bark.png": None}


def test_row_34_a_linked_library_that_is_there_is_read_and_hashed(cases):
    case = cases.read("linked_library")
    (stool,) = case.of_category("chair")
    assert stool.area_px == 100
    ((name, found),) = case.scene.files.dependencies.items()
    assert re.fullmatch(r"outside://[0-9a-f]{16}/stool\.blend", name)
    assert found is not None
    assert len(found.sha256) == 64


@pytest.mark.parametrize(
    ("name", "library"), [("lost_library", "lost.blend"), ("lost_nested_library", "inner.blend")]
)
def test_row_34_a_missing_library_is_a_failed_scene(cases, name, library):
    with pytest.raises(MissingLibraryError, match=f"'{library}' does not exist"):
        cases.read(name)
