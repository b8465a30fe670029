"""Every entry of the tables of Blender's names, by what it does in Blender's own Python."""

from __future__ import annotations

from typing import Any

import pytest
from scene.in_bpy import run_in_bpy

pytestmark = pytest.mark.blender


@pytest.fixture(scope="module")
def told() -> Any:
    return run_in_bpy("tables_in_bpy.py")


def test_a_viewport_keeps_a_scene_whose_modifiers_remember_or_read_something(told):
    assert not told["moving"]["plain"]
    assert told["moving"]["modifiers"] == [
        "BUILD", "CLOTH", "COLLISION", "CORRECTIVE_SMOOTH", "DYNAMIC_PAINT", "EXPLODE", "FLUID",
        "LAPLACIANDEFORM", "MESH_CACHE", "MESH_DEFORM", "MESH_SEQUENCE_CACHE", "OCEAN",
        "PARTICLE_INSTANCE", "PARTICLE_SYSTEM", "SOFT_BODY", "SURFACE", "SURFACE_DEFORM",
    ]  # fmt: skip


def test_a_viewport_keeps_a_scene_that_is_animated_where_a_surface_can_see_it(told):
    assert told["moving"]["data"] == [
        "cameras", "curves", "hair_curves", "lattices", "materials", "meshes", "metaballs",
        "node_groups", "nodes of a material", "objects", "pointclouds", "scenes", "shape_keys",
        "textures",
    ]  # fmt: skip
    assert told["moving"]["others"] == [
        "a marker", "a rigid body world", "an action", "a sequence of images", "a film",
        "a simulation", "a bake",
    ]  # fmt: skip


def test_missing_data_of_a_library_is_refused_where_the_view_or_a_surface_depends_on_it(told):
    assert sorted(told["missing"]) == [
        "actions", "armatures", "cameras", "collections", "curves", "fonts", "hair_curves",
        "lattices", "materials", "meshes", "metaballs", "node_groups", "objects", "particles",
        "pointclouds", "scenes", "shape_keys", "textures", "volumes",
    ]  # fmt: skip


def test_a_program_that_adds_something_that_can_render_has_built_a_scene(told):
    nothing = [kind for kind, built in told["built"].items() if not built]
    assert (nothing, len(told["built"])) == (["CAMERA", "LIGHT", "SPEAKER"], 12)


def test_an_attribute_of_any_type_is_in_a_mesh_s_hash(told):
    assert len(told["attributes"]) == 13
    assert set(map(tuple, told["attributes"].values())) == {(True, False)}


def test_an_image_times_an_attribute_cuts_where_their_sum_reaches_the_threshold(told):
    """Or says why it cannot be read."""
    read = {name: found for name, found in told["products"].items() if isinstance(found, list)}
    names = """i v; (1 - i) v; (i + 1) v; i v + 0.45; i v + 0.55; i (1 - v); i v of any v; 1 + i v;
        i v of a clipped image"""
    expected = {name.strip(): [0, True, 1] for name in names.split(";")}
    assert read == {**expected, "2 i v of v to 0.2": [0, False, 0]}
    beyond = "alpha comes from an attribute beyond 0..1, cut off there"
    no_product = "alpha is not a product of image and attribute terms"
    assert {name: why for name, why in told["products"].items() if name not in read} == {
        "i v beyond 1": beyond, "i v below 0": beyond, "(i - 0.5) v": no_product,
        "(i + 1) v of a clipped image": no_product, "1 - i v": no_product,
        "i + v": "alpha is a sum of its image and its attribute",
    }  # fmt: skip


def test_only_what_a_file_renders_with_is_a_setting(told):
    """Neither what windows show, nor what entities of their own say."""
    assert told["changed"] == [
        "node muted", "node in a group", "object out of renders", "bone without deforming",
        "pose bone moved", "curve muted", "collection out of renders", "collection held out",
        "frame", "key's value", "key's point", "vertex",
    ]  # fmt: skip
