"""What the kernel refuses, and with which error."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from visibility.kernel_scenes import pixel_camera, pixel_rectangle, place

from legoworld.errors import LegoWorldError, ShapeError
from legoworld.visibility import kernel
from legoworld.visibility.kernel import Cutouts, coverage, render

SIZE = (20, 10)
CAMERA = pixel_camera(SIZE)
GOOD = place([pixel_rectangle(CAMERA, 2, 2, 8, 8), pixel_rectangle(CAMERA, 4, 4, 9, 9)])
NAN_VERTICES = GOOD.vertices.copy()
NAN_VERTICES[5, 1] = np.nan
INF_VERTICES = GOOD.vertices.copy()
INF_VERTICES[0, 2] = -np.inf


def with_index(value):
    triangles = GOOD.triangles.copy()
    triangles[3, 2] = value
    return triangles


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vertices": GOOD.vertices.astype(np.float64)}, "vertices has the wrong type"),
        ({"vertices": GOOD.vertices[:, :2]}, "vertices has the wrong type or shape"),
        ({"vertices": np.asfortranarray(GOOD.vertices)}, "not C-contiguous"),
        ({"vertices": GOOD.vertices.tolist()}, "vertices is not an array"),
        ({"vertices": NAN_VERTICES}, "a vertex is NaN or infinite"),
        ({"vertices": INF_VERTICES}, "a vertex is NaN or infinite"),
        ({"triangles": with_index(4)}, "outside its mesh"),
        ({"triangles": with_index(-1)}, "outside its mesh"),
        ({"triangles": GOOD.triangles.astype(np.int64)}, "triangles has the wrong type"),
        ({"vertex_start": np.array([0, 4, 9])}, "vertex_start does not divide"),
        ({"triangle_start": np.array([0, 5, 4])}, "triangle_start does not divide"),
        ({"triangle_start": np.array([0, 4])}, "triangle_start has the wrong type or shape"),
        ({"vertex_start": np.array([], np.int64)}, "vertex_start has the wrong type or shape"),
        ({"placement_mesh": np.array([0, 2], np.int32)}, "placement_mesh is out of range"),
        ({"placement_mesh": np.array([-1, 1], np.int32)}, "placement_mesh is out of range"),
        ({"placement_mesh": np.array([0], np.int32)}, "cam_from_mesh has the wrong type or shape"),
        ({"placement_mesh": np.array([0, 1])}, "placement_mesh has the wrong type"),
        ({"placement_id": np.array([0, 1])}, "placement_id has the wrong type"),
        ({"cam_from_mesh": GOOD.cam_from_mesh * np.nan}, "cam_from_mesh holds a number"),
        ({"cam_from_mesh": GOOD.cam_from_mesh * 1e31}, "cam_from_mesh holds a number"),
        ({"placement_id": np.array([0, -1], np.int32)}, "placement_id is out of range"),
        ({"placement_id": np.array([0, 2**31 - 1], np.int32)}, "placement_id is out of range"),
    ],
)
@pytest.mark.parametrize("call", [render, coverage])
def test_bad_surfaces(call, changes, message):
    with pytest.raises(ShapeError, match=rf"\b{message}") as caught:
        call(dataclasses.replace(GOOD, **changes), CAMERA, SIZE)
    assert "\n" not in str(caught.value)


def test_a_bad_mesh_that_is_out_of_view_is_refused_too():
    surfaces = dataclasses.replace(
        GOOD, vertices=NAN_VERTICES, placement_mesh=np.zeros(2, np.int32)
    )
    with pytest.raises(ShapeError, match="NaN"):
        render(surfaces, CAMERA, SIZE)


@pytest.mark.parametrize("size_wh", [(0, 10), (10, 0), (8193, 10), (10, 8193), (-1, 5)])
def test_bad_sizes(size_wh):
    with pytest.raises(ShapeError, match="picture size"):
        render(GOOD, CAMERA, size_wh)


@pytest.mark.parametrize(
    "changes",
    [
        {"fx": 0.0},
        {"fy": -1.0},
        {"fx": np.nan},
        {"cx": np.inf},
        {"z_near": 0.0},
        {"z_near": 5.0, "z_far": 5.0},
        {"z_far": np.inf},
        {"z_far": 1e39},
    ],
)
def test_bad_projections(changes):
    with pytest.raises(ShapeError, match="projection"):
        render(GOOD, pixel_camera(SIZE, **changes), SIZE)


LARGEST_FLOAT32 = float(np.finfo(np.float32).max)


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        ({"fx": 1e-9}, {"fx": 0.9e-9}),
        ({"fx": 1e12}, {"fx": 1.1e12}),
        ({"fy": 1e-9}, {"fy": 0.9e-9}),
        ({"fy": 1e12}, {"fy": 1.1e12}),
        ({"cx": 1e9}, {"cx": 1.1e9}),
        ({"cx": -1e9}, {"cx": -1.1e9}),
        ({"cy": 1e9}, {"cy": 1.1e9}),
        ({"cy": -1e9}, {"cy": -1.1e9}),
        ({"z_near": 1e-9}, {"z_near": -1e-9}),
        ({"z_near": 9.9, "z_far": 10.0}, {"z_near": 10.0, "z_far": 10.0}),
        ({"z_near": -1.0, "orthographic": True}, {"z_near": -1.0, "orthographic": False}),
        ({"z_near": 0.0, "orthographic": True}, {"z_near": 0.0, "orthographic": False}),
        ({"z_far": LARGEST_FLOAT32}, {"z_far": LARGEST_FLOAT32 * 1.0001}),
        (
            {"z_near": -LARGEST_FLOAT32, "orthographic": True},
            {"z_near": -LARGEST_FLOAT32 * 1.0001, "orthographic": True},
        ),
    ],
)
@pytest.mark.parametrize("call", [render, coverage])
def test_the_last_projection_that_is_taken_and_the_first_that_is_not(call, good, bad):
    call(GOOD, pixel_camera(SIZE, **good), SIZE)
    with pytest.raises(ShapeError, match="projection"):
        call(GOOD, pixel_camera(SIZE, **bad), SIZE)


def test_the_largest_depth_is_measured_after_scaling():
    far = pixel_camera(SIZE, z_far=1e30)
    render(GOOD, far, SIZE, depth_scale=1e8)
    with pytest.raises(ShapeError, match="projection"):
        render(GOOD, far, SIZE, depth_scale=1e9)


@pytest.mark.parametrize("size_wh", [(8192, 1), (1, 8192), (1, 1)])
def test_the_largest_and_the_smallest_picture_are_drawn(size_wh):
    assert render(GOOD, pixel_camera(size_wh), size_wh).instance.shape == size_wh[::-1]


def test_the_largest_matrix_entry_is_taken():
    matrices = GOOD.cam_from_mesh.copy()
    matrices[0, 0, 3] = 1e30
    render(dataclasses.replace(GOOD, cam_from_mesh=matrices), CAMERA, SIZE)
    matrices[0, 0, 3] = -1.1e30
    with pytest.raises(ShapeError, match="cam_from_mesh holds a number"):
        render(dataclasses.replace(GOOD, cam_from_mesh=matrices), CAMERA, SIZE)


def test_what_was_found_and_expected_is_said():
    with pytest.raises(ShapeError) as caught:
        render(dataclasses.replace(GOOD, triangles=GOOD.triangles[:, :2]), CAMERA, SIZE)
    assert "int32 of shape (4, 2)" in str(caught.value)
    assert "int32 of shape (any, 3)" in str(caught.value)
    with pytest.raises(ShapeError) as caught:
        render(dataclasses.replace(GOOD, placement_mesh=np.array([0, 2], np.int32)), CAMERA, SIZE)
    assert "[0, 2]" in str(caught.value)
    assert "[0, 1]" in str(caught.value)
    with pytest.raises(ShapeError, match=r"found: -1; expected: .* -2 for a holdout"):
        render(dataclasses.replace(GOOD, placement_id=np.array([0, -1], np.int32)), CAMERA, SIZE)


@pytest.mark.parametrize("depth_scale", [0.0, -1.0, np.nan, 1e37])
def test_bad_depth_scale(depth_scale):
    with pytest.raises(ShapeError, match="projection"):
        render(GOOD, CAMERA, SIZE, depth_scale=depth_scale)


def test_bad_thread_count():
    with pytest.raises(ShapeError, match="threads"):
        render(GOOD, CAMERA, SIZE, threads=0)


def test_unknown_level(monkeypatch):
    monkeypatch.setenv("LEGOWORLD_KERNEL_LEVEL", "fastest")
    with pytest.raises(LegoWorldError, match="LEGOWORLD_KERNEL_LEVEL"):
        render(GOOD, CAMERA, SIZE)


def test_the_level_that_is_asked_for_is_drawn_with(monkeypatch):
    levels = []
    original = kernel.library()

    class Watched:
        def lw_best_level(self):
            return original.lw_best_level()

        def lw_render(self, surfaces, view, threads, level, *buffers):
            levels.append(level.value)
            return original.lw_render(surfaces, view, threads, level, *buffers)

    monkeypatch.setattr(kernel, "library", Watched)
    for level in ("baseline", "avx2", ""):
        monkeypatch.setenv("LEGOWORLD_KERNEL_LEVEL", level)
        render(GOOD, CAMERA, SIZE)
    best = original.lw_best_level()
    assert levels == [0, min(1, best), best]


ONE_NAN = np.zeros((4, 3, 2), np.float32)
ONE_NAN[3, 2, 1] = np.nan

GOOD_CUTOUTS = Cutouts(
    triangle_cutout=np.zeros(4, np.int32),
    corner_uv=np.zeros((4, 3, 2), np.float32),
    alphas=(np.zeros((2, 2), np.uint8),),
    wrap=("repeat",),
    interpolation=("closest",),
    sides=("both",),
    threshold=0.5,
)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"triangle_cutout": np.zeros(3, np.int32)}, "triangle_cutout has the wrong"),
        ({"triangle_cutout": np.ones(4, np.int32)}, "triangle_cutout is out of range"),
        ({"corner_uv": np.zeros((4, 3), np.float32)}, "corner_uv has the wrong"),
        ({"corner_uv": np.full((4, 3, 2), np.nan, np.float32)}, "corner_uv holds a NaN"),
        ({"alphas": (np.zeros((2, 2), np.float32),)}, r"alphas\[0\] has the wrong"),
        ({"alphas": (np.zeros((0, 2), np.uint8),)}, r"alphas\[0\] is empty"),
        ({"wrap": ("tile",)}, "wrap is unknown"),
        ({"interpolation": ("cubic",)}, "interpolation is unknown"),
        ({"wrap": ()}, "wrap has one entry per alpha"),
        ({"interpolation": ()}, "interpolation has one entry per alpha"),
        ({"sides": ()}, "sides has one entry per alpha"),
        ({"sides": ("left",)}, "sides is unknown"),
        ({"triangle_cutout": np.full(4, -2, np.int32)}, "triangle_cutout is out of range"),
        ({"corner_alpha": np.zeros((3, 3), np.float32)}, "corner_alpha has the wrong"),
        ({"corner_uv": ONE_NAN}, "corner_uv holds a NaN"),
        ({"corner_alpha": ONE_NAN[..., 1].copy()}, "corner_alpha holds a NaN"),
        ({"corner_alpha": np.full((4, 3), np.inf, np.float32)}, "corner_alpha holds a NaN"),
        ({"alphas": (np.zeros((2, 0), np.uint8),)}, r"alphas\[0\] is empty"),
        ({"threshold": np.nan}, "threshold"),
    ],
)
def test_bad_cutouts(changes, message):
    cutouts = dataclasses.replace(GOOD_CUTOUTS, **changes)
    with pytest.raises(ShapeError, match=rf"\b{message}"):
        render(dataclasses.replace(GOOD, cutouts=cutouts), CAMERA, SIZE)
