"""A private probe: moved samples, a second camera, and Cycles' surface against the kernel's."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from readouts.cubes import view_of

from legoworld.readouts.probing import (
    OFFSET,
    VIEW,
    looks,
    second_pose,
    second_stand,
    surface_disagreement,
)
from legoworld.readouts.surface import visible_surface
from legoworld.records.track import Probe, SecondView
from legoworld.visibility.view import surfaces_through

SIZE, HFOV = (96, 54), 60.0
STAY = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
ASIDE = ((1.0, 0.0, 0.0, 2.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.0, 1.0))


def probe(offset=(0.0, 0.0), view=None):
    return Probe(offset_px=offset, view=view, boxes_m=(), spacings_m=())


def snapshot(**options):
    return view_of(("cube", (0.3, 0.1, 5.0), 1.0), ("wall", (0.0, 0.0, 9.0), (30.0, 1.0, 30.0)),
                **options)[0].snapshot  # fmt: skip


def depth(look, raster_wh):
    return surfaces_through(look.projection, look.snapshot, raster_wh).depth_z_m


def test_without_an_offset_the_look_is_the_surface_itself():
    scene = snapshot()
    surface = visible_surface(scene, SIZE, HFOV)
    (look,) = looks(scene, SIZE, HFOV, probe())
    assert look.name == OFFSET
    assert np.array_equal(depth(look, surface.raster_wh), surface.depth_z_m)


def test_an_offset_of_a_pixel_is_the_neighbouring_sample():
    scene = snapshot()
    surface = visible_surface(scene, SIZE, HFOV)
    (look,) = looks(scene, SIZE, HFOV, probe((1.0, 2.0)))
    moved = depth(look, surface.raster_wh)
    assert (moved[:-2, :-1] == surface.depth_z_m[2:, 1:]).mean() > 0.999


def test_a_second_view_that_stays_is_the_first_one_and_one_aside_sees_from_there():
    scene = snapshot()
    surface = visible_surface(scene, SIZE, HFOV)
    same = SecondView(cam_from_view=STAY, hfov_deg=HFOV)
    first, second = looks(scene, SIZE, HFOV, probe(view=same))
    assert (first.name, second.name) == (OFFSET, VIEW)
    assert np.array_equal(depth(second, surface.raster_wh), surface.depth_z_m)
    *_, aside = looks(scene, SIZE, HFOV, probe(view=SecondView(cam_from_view=ASIDE, hfov_deg=HFOV)))
    moved = view_of(("cube", (-1.7, 0.1, 4.0), 1.0), ("wall", (-2.0, 0.0, 8.0), (30.0, 1.0, 30.0)))
    expected = visible_surface(moved[0].snapshot, SIZE, HFOV).depth_z_m
    assert np.isclose(depth(aside, surface.raster_wh), expected, rtol=1e-6).mean() > 0.999


@pytest.mark.parametrize("unit_scale", [1.0, 0.01])
def test_the_second_pose_is_in_scene_units(unit_scale):
    scene = snapshot(unit_scale=unit_scale)
    view = SecondView(cam_from_view=ASIDE, hfov_deg=HFOV)
    rows = np.array(second_pose(scene.camera, view, unit_scale))
    # The level camera: its x is the world's x, its z the world's y.
    assert np.allclose(rows[:, 3] * unit_scale, (2.0, 1.0, 0.0))
    assert np.array_equal(rows[:, :3], np.array(scene.camera.world_from_camera)[:, :3])


def test_blender_s_camera_keeps_the_ratio_of_both_fields_of_view():
    scene = snapshot()
    wide = SecondView(cam_from_view=STAY, hfov_deg=2 * math.degrees(math.atan(2.0)))
    stand = second_stand(scene, wide, 90.0)
    assert stand["zoom"] == pytest.approx(0.5)
    assert stand["world_from_camera"] == second_pose(scene.camera, wide, 1.0)


def differs(kernel, cycles, ours=None, theirs=None):
    """With one object everywhere, unless told."""
    one = np.zeros(kernel.shape, np.int32)
    ours, theirs = (one if objects is None else objects for objects in (ours, theirs))
    return surface_disagreement(kernel, cycles, ours.astype(np.int64), theirs, 0.05)


def test_cycles_agrees_with_any_depth_around_and_with_no_other():
    kernel = np.full((6, 8), 4.0, np.float32)
    kernel[:, 4:] = 8.0
    kernel[0, :] = np.inf
    assert differs(kernel, kernel) == 0.0
    edge = kernel.copy()
    edge[2:, 3:5] = 6.0  # between both sides of a step
    edge[1, :] = np.inf  # the sample fell above the border
    assert differs(kernel, edge) == 0.0
    through = np.where(np.isfinite(kernel), np.float32(20.0), kernel)
    assert differs(kernel, through) == 4 / 5  # all but below the border
    gone = np.full_like(kernel, np.inf)
    gone[1] = kernel[1]
    assert differs(kernel, gone) == 4 / 5
    near = replace_row(kernel, 3, 3.9)
    assert differs(kernel, near) == pytest.approx(3 / 40)  # of the 8 m alone
    nothing = np.full((3, 3), np.inf, np.float32)
    assert differs(nothing, nothing) is None


def test_cycles_agrees_with_any_object_around_and_with_no_other():
    """A copy that only the renderer sees, a hair before the surface, is at an agreeing depth."""
    depth = np.full((6, 8), 4.0, np.float32)
    ours = np.zeros((6, 8), np.int32)
    ours[:, 4:] = 1
    shifted = np.roll(ours, 1, axis=1)
    shifted[:, 0] = 0
    assert differs(depth, depth, ours, shifted) == 0.0
    assert differs(depth, depth, ours, np.where(ours, 0, 1)) == 36 / 48  # but for the border's two
    assert differs(depth, depth, ours, np.full_like(ours, 2)) == 1.0
    unknown = np.full_like(ours, -1)  # an object that Cycles was not asked about
    assert differs(depth, depth, unknown, ours) == 1.0
    nothing = np.full_like(depth, np.inf)
    assert differs(nothing, nothing, unknown, ours) is None
    behind = np.where(ours, np.float32(np.inf), depth)
    assert differs(behind, behind, np.where(ours, -1, 0), ours * 0) == 0.0


def replace_row(values, row, value):
    changed = values.copy()
    changed[row] = value
    return changed


def test_looks_leave_the_snapshot_as_it_is():
    scene = snapshot()
    before = replace(scene)
    list(looks(scene, SIZE, HFOV, probe(view=SecondView(cam_from_view=ASIDE, hfov_deg=HFOV))))
    assert scene.camera == before.camera
