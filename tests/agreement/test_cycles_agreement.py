"""Every trap scene read by us and by Cycles: the same object, at the same depth.

Three processes are started once: one builds the scenes, one is the judge, one is our own reader.
They are held to more than real scenes are: nothing in them is smaller than a pixel.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from agreement.comparison import LEAST_NORMAL, compare, compare_normals
from agreement.judge import Judge
from agreement.ours import picture_of, snapshot_of

from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.folder import SceneFolder

pytestmark = pytest.mark.blender

TESTS = Path(__file__).resolve().parents[1]

#: Rooms whose objects have edges that no id shows: where one strand crosses another of its object.
STRANDS = ("strands", "particle_hair")

#: What is displaced is not read, and flat ribbons are shaded as if they were round.
SHADED_OTHERWISE = ("displaced", "wide_ribbons")

TRAPS = [
    "mixed_primitives",
    "twisted_scales",
    "ngons",
    "render_levels",
    "modifiers",
    "deformed",
    "camera_scale_small",
    "camera_scale_large",
    "camera_scale_uneven",
    "camera_scale_mirrored",
    "camera_scale_backward",
    "fit_auto_portrait",
    "fit_vertical",
    "fit_vertical_portrait",
    "fit_horizontal_portrait",
    "shifted",
    "shifted_portrait",
    "aspect_2_1",
    "aspect_1_2",
    "aspect_10_11",
    "percentage",
    "orthographic",
    "orthographic_portrait",
    "orthographic_clipped",
    "camera_parented",
    "camera_tracked",
    "clip_planes",
    "near_plane_room",
    "inside_sphere",
    "unit_scale",
    "frame_and_marker",
    "marker_not_applied",
    "late_marker",
    "hidden_camera",
    "simplified",
    "animated_switches",
    "driven",
    "camera_effects",
    "degenerate",
    "is_viewport",
    "nodes_over_instancers",
    "nodes_with_materials",
    "displaced",
    "nested_collections",
    "instanced_hidden",
    "hidden_instancers",
    "geometry_nodes",
    "hair_instances",
    "emitted_particles",
    "vertex_and_face_duplicates",
    "shared_mesh",
    "object_switches",
    "collection_switches",
    "indirect_only",
    "holdouts",
    "held_out_instances",
    "shadow_catcher",
    "display_types",
    "far_away_camera_ray_switches",
    "constant_alpha",
    "leaf_cards",
    "alpha_wirings",
    "solid_or_not",
    "material_links",
    "layered_cards",
    "alpha_images",
    "alpha_interpolations",
    "alpha_instances",
    "alpha_deformed_uv",
    "alpha_graphs",
    "alpha_maths",
    "alpha_tricks",
    "alpha_color_attributes",
    "alpha_attribute_outputs",
    "alpha_attribute_kinds",
    "alpha_attribute_maths",
    "alpha_one_value",
    "alpha_sides",
    "alpha_unread_attributes",
    "alpha_imported_gltf",
    "curves",
    "text",
    "metaballs",
    "nurbs",
    "instanced_kinds",
    "nothing_to_see",
    "ribbons",
    "finest_ribbons",
    "coarsest_ribbons",
    "wide_ribbons",
    "thick",
    "thick_linear",
    "poly_curves",
    "no_radius",
    "placed_fur",
    "particle_hair",
    "particle_children",
    "hair_switches",
    "hair_moved",
    "hair_held_out",
    "hair_layer_off",
    "node_curves",
    "point_clouds",
    "several_scenes",
    "view_layers",
    "view_layers_second_active",
    "view_layers_first_unused",
    "layer_material",
    "linked_library",
]


@dataclass(frozen=True, kw_only=True)
class Court:
    """The trap scenes, and the two processes that read them."""

    scenes: Path
    judge: Judge
    blender: BlenderProcess


@pytest.fixture(scope="module")
def court(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Court]:
    folder = tmp_path_factory.mktemp("agreement")
    scenes = folder / "scenes"
    builder = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("build.py")), str(scenes)],
        # The builder ends without Blender's own exit, which would empty its temporary folder.
        env={**os.environ, "PYTHONPATH": str(TESTS), "TMPDIR": str(folder)},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert builder.returncode == 0, builder.stderr[-3000:]
    with (
        (folder / "judge.log").open("wb") as log,
        Judge(log) as judge,
        BlenderProcess(Limits(time_s=600)) as blender,
    ):
        yield Court(scenes=scenes, judge=judge, blender=blender)


def test_every_built_scene_is_judged(court: Court) -> None:
    assert sorted(p.name for p in court.scenes.iterdir()) == sorted(TRAPS)


@pytest.mark.parametrize("name", TRAPS)
def test_the_same_object_at_the_same_depth_with_the_same_normal(court: Court, name: str) -> None:
    folder = court.scenes / name
    expected = json.loads((folder / "expect.json").read_text(encoding="utf-8"))
    scene = SceneFolder(path=folder, name=name)
    snapshot = snapshot_of(scene, court.blender, corner_normals=True)
    size = snapshot.render.size_wh
    ours = picture_of(snapshot, size)
    cycles = court.judge.picture_of(folder / "scene.blend", size, folder / "cycles.npz")
    _check_that_the_trap_is_one(expected, set(cycles.areas()))
    limited = expected["limited"]
    for one in limited:
        assert any(repr(one) in w for w in snapshot.warnings), f"no warning names {one!r}"
    found = compare(ours, cycles, [n for n in {*ours.names, *cycles.names} if _plain(n) in limited])
    assert found.verdict == "ok", f"{expected['about']} {found}"
    assert found.same >= 0.999, found
    assert found.same_inside >= 0.9999, found
    assert found.depth >= (0.9995 if expected["room"] in STRANDS else 0.9999), found
    normals = compare_normals(ours, cycles)
    assert normals.within >= LEAST_NORMAL or name in SHADED_OTHERWISE, normals


def _plain(name: str) -> str:
    return name.split("|")[0]


def _check_that_the_trap_is_one(expected: dict[str, Any], visible: set[str]) -> None:
    seen = {_plain(name) for name in visible}
    assert set(expected["seen"]) <= seen
    assert not set(expected["unseen"]) & seen
