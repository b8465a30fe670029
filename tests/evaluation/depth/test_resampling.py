"""Reading a prediction between its pixels: half-pixel right, in disparity, around holes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from legoworld.errors import ShapeError
from legoworld.evaluation.depth.arrays import DepthArray, DepthPredictionError, Space
from legoworld.evaluation.depth.family import PIXELS
from legoworld.evaluation.depth.rows import camera_warp
from legoworld.evaluation.pixels.resampling import bilinear, sampler, size_check
from legoworld.tracks.colmap import Camera

Array = NDArray[Any]


def array(values: Array, space: Space = "disparity") -> DepthArray:
    return DepthArray(values=values, space=space, unit=None, intrinsics_px=None)


def everywhere(prediction: DepthArray, size_wh: tuple[int, int]) -> tuple[Array, Array]:
    """Disparity and mask at every truth pixel, (H, W)."""
    rows, cols = (i.ravel() for i in np.mgrid[: size_wh[1], : size_wh[0]])
    found = sampler(prediction, size_wh, None)(rows, cols)
    shape = size_wh[::-1]
    return found.values.reshape(shape), found.predicted.reshape(shape)


def test_a_ramp_stays_the_same_ramp() -> None:
    # A disparity linear in the picture's coordinates is linear at any size: half a pixel off
    # would show as a constant difference.
    y, x = np.mgrid[:20, :30] + 0.5
    values, predicted = everywhere(array(2.0 + x / 30 + 3 * y / 20), (120, 80))
    y, x = np.mgrid[:80, :120] + 0.5
    expected = 2.0 + x / 120 + 3 * y / 80
    inner = (slice(2, -2), slice(2, -2))  # half a source pixel at the edge is held constant
    assert predicted.all()
    np.testing.assert_allclose(values[inner], expected[inner], rtol=1e-13)


def test_it_is_opencv_s_bilinear_where_nothing_is_missing() -> None:
    import cv2

    values = np.random.default_rng(0).uniform(1, 2, (17, 23)).astype(np.float32)
    ours, _ = everywhere(array(values), (61, 45))
    theirs = cv2.resize(values, (61, 45), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(ours, theirs, rtol=2e-6)


def test_depth_is_interpolated_in_disparity() -> None:
    values, _ = everywhere(array(np.array([[1.0, 4.0]]), "depth"), (4, 2))
    np.testing.assert_allclose(values[0], [1, 0.8125, 0.4375, 0.25], rtol=1e-15)


def test_one_hole_takes_its_own_area_and_nothing_else() -> None:
    depth = np.full((4, 4), 2.0)
    depth[1, 2] = np.inf
    values, predicted = everywhere(array(depth, "depth"), (16, 16))
    expected = np.ones((16, 16), bool)
    expected[4:8, 8:12] = False
    # The area of the hole's pixel, less the corner points that three neighbours outweigh.
    expected[np.ix_([4, 7], [8, 11])] = True
    assert np.array_equal(predicted, expected)
    np.testing.assert_allclose(values[predicted], 0.5, rtol=1e-15)


def test_same_size_is_untouched_even_beside_holes() -> None:
    depth = np.random.default_rng(1).uniform(1, 5, (9, 7)).astype(np.float32)
    depth[4, 3] = np.inf
    values, predicted = everywhere(array(depth, "depth"), (7, 9))
    assert np.array_equal(predicted, np.isfinite(depth))
    assert np.array_equal(values[predicted], 1 / depth[predicted].astype(np.float64))


def test_positions_on_and_beyond_the_edge() -> None:
    prediction = array(np.array([[1.0, 2.0], [3.0, 4.0]]))
    xy = np.array([[0.0, 0.0], [2.0, 2.0], [1.0, 1.0], [-0.01, 1.0], [1.0, 2.01]])
    found = bilinear(prediction, xy)
    assert found.predicted.tolist() == [True, True, True, False, False]
    assert found.outside.tolist() == [False, False, False, True, True]
    assert found.values.tolist() == [1.0, 4.0, 2.5, 0.0, 0.0]
    # The edge's rounding errors count as inside, up to the last of them.
    last = np.array([[-1e-6, 1.0], [2 + 1e-6, 1.0], [1.0, -1e-6], [1.0, 2 + 1e-6]])
    assert bilinear(prediction, last).predicted.all()
    assert bilinear(prediction, last + (last - 1) * 1e-6).outside.all()


@pytest.mark.parametrize(
    "size_wh", [(741, 500), (740, 500), (504, 336), (518, 350), (37, 25), (3, 2), (1, 1)]
)
def test_sizes_that_are_the_truth_s_picture(size_wh: tuple[int, int]) -> None:
    size_check(PIXELS, (741, 500))(size_wh)


@pytest.mark.parametrize(
    ("size_wh", "word"),
    [((1482, 1000), "1482x1000"), ((742, 500), "742x500"), ((500, 741), "rotated"),
     ((500, 500), "500x500"), ((741, 400), "741x400")],
)  # fmt: skip
def test_sizes_that_are_not(size_wh: tuple[int, int], word: str) -> None:
    with pytest.raises(DepthPredictionError, match=word):
        size_check(PIXELS, (741, 500))(size_wh)


def test_a_camera_of_another_size_is_refused() -> None:
    camera = Camera(model="PINHOLE", size_wh=(8, 8), params=(8, 8, 4, 4))
    with pytest.raises(ShapeError):
        camera_warp(camera, (4, 4))
