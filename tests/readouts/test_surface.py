"""The visible surface of squares at known distances, and the camera that saw them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from readouts.quads import SQUARE, at, quads
from scene.by_hand import CAMERA

from legoworld.readouts.surface import (
    pose_m,
    render_file,
    submitted_camera,
    surface_file,
    visible_surface,
    write_surface,
)
from legoworld.visibility.scoring_raster import raster_size

SIZE = (640, 480)
#: The test camera's own: a lens as long as its sensor is wide.
OWN_HFOV = math.degrees(2 * math.atan(0.5))


def wall(**changes):
    """A square of side 20 at 12 units in front of the camera, so that it fills the picture."""
    return quads(("Wall", SQUARE * 10, at(0, 0, -2)), **changes)


def test_depth_is_planar_and_in_metres():
    seen = visible_surface(wall(unit_scale=0.5), SIZE, OWN_HFOV)
    width, height = seen.raster_wh
    assert (width, height) == raster_size(SIZE)
    assert seen.depth_z_m.shape == seen.surface_index.shape == (height, width)
    assert seen.depth_z_m.dtype == np.float32
    assert np.allclose(seen.depth_z_m, 6.0)
    assert (seen.surface_index == 0).all()
    assert seen.finite_px == width * height


def test_what_is_not_hit_is_infinite_and_shows_nothing():
    seen = visible_surface(quads(("Small", SQUARE, at(0, 0, 0))), SIZE, OWN_HFOV)
    hit = np.isfinite(seen.depth_z_m)
    # 2 of the 10 x 7.5 units that are seen at this distance.
    assert hit.mean() == pytest.approx(4 / 75, rel=0.02)
    assert (seen.surface_index[hit] == 0).all()
    assert (seen.surface_index[~hit] == -1).all()
    assert np.isposinf(seen.depth_z_m[~hit]).all()
    assert seen.finite_px == hit.sum()


def test_the_nearer_square_is_shown():
    scene = quads(("Far", SQUARE * 10, at(0, 0, -2)), ("Near", SQUARE, at(0, 0, 5)))
    seen = visible_surface(scene, SIZE, OWN_HFOV)
    middle = tuple(n // 2 for n in seen.surface_index.shape)
    assert (seen.surface_index[middle], seen.depth_z_m[middle]) == (1, 5.0)
    assert (seen.surface_index[0, 0], seen.depth_z_m[0, 0]) == (0, 12.0)


def test_the_reference_s_field_of_view_is_used_and_the_own_one_kept_beside_it():
    small = quads(("Small", SQUARE, at(0, 0, 0)))
    seen = visible_surface(small, SIZE, 2 * OWN_HFOV)
    focal = SIZE[0] / 2 / math.tan(math.radians(OWN_HFOV))
    share = seen.raster_wh[0] / SIZE[0]
    assert seen.projection.fx == pytest.approx(focal * share)
    assert seen.own_projection is not None
    assert seen.own_depth_z_m is not None
    assert seen.own_projection.fx == pytest.approx(SIZE[0] * share)
    # A longer focal length shows the same square larger.
    assert np.isfinite(seen.own_depth_z_m).sum() > 4 * seen.finite_px


def test_the_own_camera_is_kept_only_where_it_differs_and_is_asked_for():
    assert visible_surface(wall(), SIZE, OWN_HFOV).own_projection is None
    nearly = visible_surface(wall(), SIZE, OWN_HFOV * (1 + 1e-8))
    assert nearly.own_projection is not None
    other = visible_surface(wall(), SIZE, 2 * OWN_HFOV, own_intrinsics=False)
    assert (other.own_projection, other.own_depth_z_m) == (None, None)
    ortho = replace(CAMERA, type="ORTHO")
    assert visible_surface(wall(camera=ortho), SIZE, OWN_HFOV).own_projection is None


@pytest.mark.parametrize("shift", ["shift_x", "shift_y"])
def test_a_shifted_camera_differs(shift):
    seen = visible_surface(wall(camera=replace(CAMERA, **{shift: 0.1})), SIZE, OWN_HFOV)
    assert seen.own_projection is not None
    assert seen.own_projection != seen.projection


def test_the_clip_range_is_the_camera_s_own():
    assert visible_surface(wall(camera=replace(CAMERA, clip_end=11.0)), SIZE, 60).finite_px == 0
    assert visible_surface(wall(camera=replace(CAMERA, clip_start=13.0)), SIZE, 60).finite_px == 0
    assert visible_surface(wall(camera=replace(CAMERA, clip_end=12.5)), SIZE, 60).finite_px > 0
    # An orthographic camera may begin to see behind itself; read as a pinhole it cannot.
    behind = replace(CAMERA, type="ORTHO", clip_start=-5.0)
    assert visible_surface(wall(camera=behind), SIZE, 60).finite_px > 0
    beyond = replace(CAMERA, type="ORTHO", clip_start=13.0)
    assert visible_surface(wall(camera=beyond), SIZE, 60).finite_px == 0


def test_the_submitted_camera_is_in_pixels_and_metres():
    camera = submitted_camera(wall(unit_scale=0.1), SIZE)
    assert (camera.type, camera.fx, camera.fy, camera.cx, camera.cy) == (
        "PERSP",
        640.0,
        640.0,
        320.0,
        240.0,
    )
    assert camera.hfov_deg == pytest.approx(OWN_HFOV)
    assert camera.clip_start_m == pytest.approx(0.01)
    assert camera.clip_end_m == pytest.approx(10.0)
    assert camera.world_from_cam == (
        (1.0, 0.0, 0.0, 0.0),
        (0.0, -1.0, 0.0, 0.0),
        (0.0, 0.0, -1.0, 1.0),
        (0.0, 0.0, 0.0, 1.0),
    )
    assert camera.world_from_cam == pose_m(CAMERA, 0.1)


def test_an_orthographic_camera_has_pixels_a_metre_and_no_field_of_view():
    camera = submitted_camera(wall(camera=replace(CAMERA, type="ORTHO"), unit_scale=0.5), SIZE)
    assert (camera.type, camera.hfov_deg) == ("ORTHO", None)
    # 640 pixels over 6 units of half a metre.
    assert camera.fx == pytest.approx(640 / 6 / 0.5)
    assert camera.fy == pytest.approx(640 / 6 / 0.5)


def test_what_the_surface_file_holds(tmp_path):
    seen = visible_surface(wall(), SIZE, 2 * OWN_HFOV)
    plane = np.full(seen.surface_index.shape, -1, np.int16)
    textures = np.zeros((1, 36, 64, 3), np.uint8)
    write_surface(tmp_path / "all.npz", seen, plane, textures)
    with np.load(tmp_path / "all.npz") as stored:
        assert sorted(stored) == [
            "depth_z_m",
            "intrinsics_px",
            "own_depth_z_m",
            "own_intrinsics_px",
            "plane",
            "textures",
        ]
        p = seen.projection
        assert stored["intrinsics_px"].tolist() == [p.fx, p.fy, p.cx, p.cy]
        assert seen.own_projection is not None
        o = seen.own_projection
        assert stored["own_intrinsics_px"].tolist() == [o.fx, o.fy, o.cx, o.cy]
        assert np.array_equal(stored["depth_z_m"], seen.depth_z_m)
        assert np.array_equal(stored["own_depth_z_m"], seen.own_depth_z_m)
        assert np.array_equal(stored["plane"], plane)
    write_surface(tmp_path / "plain.npz", visible_surface(wall(), SIZE, OWN_HFOV))
    with np.load(tmp_path / "plain.npz") as stored:
        assert sorted(stored) == ["depth_z_m", "intrinsics_px"]


def test_where_the_files_lie():
    assert surface_file("family/a") == "surface/family/a.npz"
    assert render_file("family/a") == "render/family/a.png"
