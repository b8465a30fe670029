"""Rows 22 to 25 and 27 of the readout cases: what a render shows of an object."""

from __future__ import annotations

import numpy as np
import pytest

pytestmark = pytest.mark.blender

# The 4 x 4 alpha of the scene image_alpha, top row first.
ALPHA = np.array([[0, 1, 1, 1], [1, 0, 0.3, 1], [1, 1, 0, 0.3], [0.3, 1, 1, 0]])


def test_row_22_geometry_is_in_the_renders_state(cases):
    case = cases.read("render_levels")
    snapshot = case.scene.snapshot
    counts = np.diff(snapshot.vertex_start)[snapshot.surface_mesh]
    assert sorted(counts.tolist()) == [4, 8, 81]
    assert case.area("Subdivided") == 400
    assert case.bbox("Not widened") == [55, 25, 10, 10]
    assert case.bbox("Widened") == [50, 5, 20, 10]


def test_row_23_switches_of_objects_and_collections(cases):
    case = cases.read("switches")
    seen = {e.name: e.area_px for e in case.entries}
    assert "hide_render" not in seen
    assert seen["behind hide_render"] == 225
    assert (seen["hide_viewport"], seen["behind hide_viewport"]) == (225, 0)
    assert "camera off" not in seen
    assert seen["behind camera off"] == 225
    assert (seen["shadow off"], seen["behind shadow off"]) == (225, 0)
    assert "excluded" not in seen
    assert seen["behind excluded"] == 225
    assert "indirect" not in seen
    assert seen["behind indirect"] == 225
    assert seen["eye closed"] == 225
    assert "in a hidden collection" not in seen
    assert seen["in a viewport-hidden collection"] == 225


def test_row_23_a_holdout_hides_what_is_behind_it_and_is_not_seen(cases):
    case = cases.read("switches")
    for name in ("holdout", "holdout and indirect"):
        assert case.one(name).area_px == 0
        assert case.one(name).reason == "holdout"
        assert case.one(f"behind {name}").area_px == 0
    assert (case.instance[20:35, 40:55] == -1).all()
    assert np.isposinf(case.depth[20:35, 40:55]).all()


def test_row_23_children_of_hidden_objects_are_shown_and_theirs(cases):
    case = cases.read("switches")
    assert case.one("hidden parent").objects == ("child of a hidden one",)
    assert case.area("hidden parent") == 13 * 15


def test_row_23_switches_inside_instances_count_as_cycles_counts_them(cases):
    case = cases.read("instanced_switches")
    seen = sorted((e.name, e.area_px, e.reason) for e in case.of_category("thing"))
    assert seen == [
        ("Held out inside", 64, None),
        ("Plain", 0, "holdout"),
        ("Plain", 64, None),  # what the instancer between says does not count
    ]


def test_row_23_an_instancer_shows_itself_only_where_renders_show_it(cases):
    case = cases.read("shown_instancers")
    plates = case.of_category("plate")
    assert [p.name for p in plates] == ["Plate True"]
    assert len(case.of_category("dot")) == 8


def test_row_24_an_unlabelled_wall_occludes(cases):
    case = cases.read("wall")
    assert case.area("Chair") == 20 * 40
    assert case.bbox("Chair") == [10, 10, 20, 40]
    assert case.one("Wall").category is None
    assert case.area("Wall") == 50 * 60


def test_row_25_constant_alpha_glass_and_volumes(cases):
    case = cases.read("constant_alpha")
    cards = {c.name: c.area_px for c in case.of_category("card")}
    assert cards == {
        "alpha 0.5": 80,
        "alpha 0.7": 80,
        "alpha 1.0": 80,
        "Glass": 200,
        "Void": 200,
        "Half": 200,
    }
    assert case.bbox("Half") == [20, 40, 20, 10]
    assert case.area("Wall") == 4800 - sum(cards.values())


@pytest.mark.parametrize(
    ("name", "there"),
    [
        ("as it is", ALPHA >= 0.5),
        ("colour", ALPHA >= 0.5),
        ("inverted", ALPHA <= 0.5),
        ("over 0.2", ALPHA > 0.2),
        ("gltf mask", ALPHA >= 0.25),
        ("over 0", ALPHA > 0.0),
        # u' = 1 - v, v' = u: the top left corner reads the picture's lower left one.
        ("turned", np.rot90(ALPHA, -1) >= 0.5),
        ("noise", np.ones((4, 4), bool)),
        ("missing", np.ones((4, 4), bool)),
    ],
)
def test_row_25_image_alpha_cuts_texel_by_texel(cases, name, there):
    case = cases.read("image_alpha")
    card = case.mask(name)
    corner = {
        "as it is": (0, 0), "colour": (20, 0), "inverted": (40, 0), "over 0.2": (60, 0),
        "gltf mask": (0, 20), "over 0": (20, 20), "turned": (60, 20), "noise": (0, 40),
        "missing": (20, 40),
    }[name]  # fmt: skip
    x, y = corner
    expected = np.repeat(np.repeat(there, 4, axis=0), 4, axis=1)
    assert np.array_equal(card[y : y + 16, x : x + 16], expected)
    assert int(card.sum()) == int(expected.sum())


def test_row_25_alpha_that_never_reaches_a_half_removes_the_surface(cases):
    assert cases.read("image_alpha").named("half") == []


def test_row_25_a_light_path_is_the_camera_rays(cases):
    case = cases.read("image_alpha")
    assert case.area("camera ray") == 256
    assert case.named("shadow ray") == []


def test_row_25_without_a_uv_map_the_lower_left_texel_decides(cases):
    assert cases.read("image_alpha").area("no map") == 0  # it is 0.3


def test_row_25_what_the_rule_cannot_read_is_named(cases):
    warnings = cases.read("image_alpha").warnings
    assert "material 'noise': alpha comes from a Noise Texture node; " in warnings[1]
    assert warnings[0] == (
        "material 'missing': the alpha image 'gone' is missing; its surface is taken as opaque"
    )
    assert len(warnings) == 2


def test_row_25_the_objects_material_wins_over_its_datas(cases):
    case = cases.read("material_links")
    assert case.area("Object's material") == 400
    assert case.area("Curve") == 64


def test_row_25_a_view_layers_material_wins_over_all(cases):
    assert cases.read("material_override").area("Card") == 400


def test_row_25_a_holdout_shader_holds_out_its_own_faces_only(cases):
    case = cases.read("holdout_shader")
    assert case.bbox("Half") == [20, 40, 20, 10]
    assert case.area("Half") == 200
    assert case.area("Wall") == 4800 - 400
    assert (case.instance[40:50, 0:20] == -1).all()


def test_row_27_scales_mirrors_and_back_faces(cases):
    case = cases.read("scales")
    assert (case.area("Mirrored"), case.bbox("Mirrored")) == (100, [5, 5, 10, 10])
    assert (case.area("Stretched"), case.bbox("Stretched")) == (120, [25, 28, 30, 4])
    assert (case.area("Back face"), case.bbox("Back face")) == (100, [65, 5, 10, 10])
    # A diamond of diagonals 2 * 14.142 and 14.142 around (20, 45).
    assert case.bbox("Skewed") == [7, 38, 26, 14]
    assert abs(case.area("Skewed") - 200) <= 8
    assert np.isfinite(case.depth[case.mask("Skewed")]).all()
