"""Residuals in the picture: laws of masks, of one fit of depth, and of orders."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kendalltau

from legoworld.plugin import residuals

masks = st.integers(0, 2**32 - 1).map(
    lambda seed: np.random.default_rng(seed).random((17, 23)) < 0.4
)


def square(x, y, side, size_wh=(64, 48)):
    mask = np.zeros(size_wh[::-1], bool)
    mask[y : y + side, x : x + side] = True
    return mask


@given(masks)
def test_a_mask_beside_itself_has_no_residual(mask):
    shape = residuals.measure_shape(mask)
    assert residuals.centroid_offset(shape, shape, (23, 17)) == (0.0, 0.0)
    assert residuals.extent_ratio(shape, shape) == (0.0, 0.0)
    assert residuals.overlap(mask, mask) == 1.0
    assert residuals.boundary_distance_px(mask, mask) == 0.0


@given(masks, masks)
def test_overlap_and_boundary_are_symmetric(first, second):
    assert residuals.overlap(first, second) == residuals.overlap(second, first)
    there = residuals.boundary_distance_px(first, second)
    assert there == residuals.boundary_distance_px(second, first)


@pytest.mark.parametrize("shift", [1, 5, 20])
def test_a_shift_is_its_share_of_the_picture(shift):
    a, b = (
        residuals.measure_shape(square(10 + shift, 8, 12)),
        residuals.measure_shape(square(10, 8, 12)),
    )
    du, dv = residuals.centroid_offset(a, b, (64, 48))
    assert du == pytest.approx(shift / 64, abs=1e-15)
    assert dv == 0.0


def test_twice_the_size_is_log_two():
    a, b = residuals.measure_shape(square(4, 4, 20)), residuals.measure_shape(square(4, 4, 10))
    assert residuals.extent_ratio(a, b) == pytest.approx((np.log(2), np.log(2)), abs=1e-15)


def test_the_outline_of_a_square_is_its_rim_and_a_shifted_one_lies_beside_it():
    assert residuals.outline(square(4, 4, 10)).sum() == 36
    apart = residuals.boundary_distance_px(square(4, 4, 10), square(6, 4, 10))
    assert 0.5 < apart < 2.0


@given(st.floats(0.01, 10), st.floats(-0.5, 2), st.integers(0, 99))
def test_depth_under_any_affine_disparity_has_no_residual(a, b, seed):
    random = np.random.default_rng(seed)
    inverse = random.uniform(0.2, 2.0, 5)
    disparity = (inverse - b) / a
    fit = residuals.fit_depth(list(zip(inverse, disparity, strict=True)))
    depth = (1 / inverse).astype(np.float32).repeat(20).reshape(10, 10)
    seen = residuals.depth_residual(fit, depth, disparity.repeat(20).reshape(10, 10), depth > 0)
    assert seen == pytest.approx(0.0, abs=1e-5)


def test_an_object_twice_as_far_has_a_residual_of_log_two():
    inverse = np.array([0.25, 0.5, 1.0, 2.0])
    fit = residuals.DepthFit(a=1.0, b=0.0)
    depth = np.full((8, 8), 2 / inverse[1], np.float32)
    seen = residuals.depth_residual(fit, depth, np.full((8, 8), inverse[1]), depth > 0)
    assert seen == pytest.approx(np.log(2), abs=1e-12)


@pytest.mark.parametrize(
    "pairs",
    [
        [(1.0, 1.0), (2.0, 2.0)],
        [(1.0, 3.0), (2.0, 3.0), (3.0, 3.0)],
        [(3.0, 1.0), (2.0, 2.0), (1.0, 3.0)],
    ],
    ids=["two regions", "no spread", "near is far"],
)
def test_a_fit_that_says_nothing_is_none(pairs):
    assert residuals.fit_depth(pairs) is None


def test_fewer_than_sixteen_pixels_are_unknown():
    depth = np.ones((5, 5), np.float32)
    both = np.zeros((5, 5), bool)
    both.flat[:15] = True
    assert residuals.median_pair(depth, depth.astype(float), both) is None
    both.flat[15] = True
    assert residuals.median_pair(depth, depth.astype(float), both) == (1.0, 1.0)


@given(st.lists(st.integers(0, 30), min_size=2, max_size=12, unique=True), st.randoms())
def test_tau_is_scipys_where_there_are_no_ties(values, random):
    other = list(values)
    random.shuffle(other)
    share, tau = residuals.inversions(values, other)
    assert tau == pytest.approx(kendalltau(values, other).statistic, abs=1e-12)
    assert share == pytest.approx((1 - tau) / 2, abs=1e-12)


def test_a_tie_on_either_side_is_neither_order():
    assert residuals.inversions([1, 1, 2], [3, 2, 1]) == (2 / 3, -2 / 3)
    assert residuals.inversions([1, 2, 3], [5, 5, 5]) == (0.0, 0.0)
