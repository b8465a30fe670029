"""Rows 28 to 31 of the readout cases: cameras, units and frames."""

from __future__ import annotations

import numpy as np
import pytest

from legoworld.errors import NoCameraError, UnsupportedCameraError

pytestmark = pytest.mark.blender


def test_row_28_a_portrait_pictures_sensor_spans_its_height(cases):
    case = cases.read("portrait")
    p = case.view.projection
    assert case.view.size_wh == (480, 640)
    assert p.fx == p.fy == pytest.approx(50 / 36 * 640, rel=1e-12)
    assert (p.cx, p.cy) == (240.0, 320.0)


@pytest.mark.parametrize(
    "name",
    ["portrait", "shifted_and_stretched", "vertical_fit", "horizontal_portrait", "orthographic"],
)
def test_row_29_the_projection_is_blenders_own(cases, name):
    """calc_matrix_camera maps camera space to -1..1 over the picture, y upwards."""
    case = cases.read(name)
    p = case.view.projection
    width, height = case.expected["size_wh"]
    matrix = np.array(case.expected["matrix"])
    assert case.view.size_wh == (width, height)
    for point in ([0.3, -0.7, -4.0], [-2.0, 1.0, -9.0], [0.0, 0.0, -1.0]):
        clip = matrix @ [*point, 1.0]
        u = (clip[0] / clip[3] + 1.0) / 2.0 * width
        v = (1.0 - clip[1] / clip[3]) / 2.0 * height
        x, y, z = point[0], -point[1], -point[2]
        depth = 1.0 if p.orthographic else z
        assert p.cx + p.fx * x / depth == pytest.approx(u, abs=2e-4)
        assert p.cy + p.fy * y / depth == pytest.approx(v, abs=2e-4)


def test_row_29_resolution_percentage_rounds_down(cases):
    assert cases.read("shifted_and_stretched").view.size_wh == (320, 213)


def test_row_30_orthographic_depth_is_planar_z(cases):
    case = cases.read("orthographic")
    p = case.view.projection
    slope = case.mask("Slope")
    columns = np.nonzero(slope)[1]
    x = (columns + 0.5 - p.cx) / p.fx
    assert slope.sum() > 1000
    assert np.allclose(case.depth[slope], 10.0 + x, rtol=1e-6, atol=0)


def test_row_30_a_panoramic_camera_is_a_typed_error(cases):
    with pytest.raises(UnsupportedCameraError, match="camera type PANO"):
        cases.read("panoramic")


def test_row_30_no_camera_is_a_typed_error(cases):
    with pytest.raises(NoCameraError, match="no camera object"):
        cases.read("no_camera")


def test_row_30_the_camera_objects_scale_is_removed(cases):
    case = cases.read("scaled_camera")
    assert (case.depth == 5.0).all()


def test_row_31_the_unit_scale_turns_depth_into_metres(cases):
    case = cases.read("centimetres")
    assert case.scene.snapshot.render.unit_scale == pytest.approx(0.01)
    assert case.scene.snapshot.render.unit_system == "METRIC"
    assert (case.depth == np.float32(1.0)).all()


def test_row_31_the_saved_frame_is_used_and_recorded(cases):
    case = cases.read("saved_frame")
    assert case.scene.snapshot.render.frame == 4
    assert case.bbox("Mover") == [30, 0, 10, 10]


def test_row_31_a_marker_switches_the_camera_at_the_saved_frame(cases):
    case = cases.read("marker_camera")
    assert case.scene.snapshot.camera.name == "Camera.001"
    assert (case.depth == 5.0).all()
