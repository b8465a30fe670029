"""The fit against longdouble least squares, and what it says when there is nothing to fit."""

from __future__ import annotations

from functools import reduce

import numpy as np
import pytest

from legoworld.errors import ShapeError
from legoworld.evaluation.depth.scoring import (
    Moments,
    aligned_z,
    compute_moments,
    merge_moments,
    solve,
)


def exact_line(x, y) -> tuple[float, float]:
    """Least squares in longdouble by centred normal equations."""
    x, y = x.astype(np.longdouble), y.astype(np.longdouble)
    dx, dy = x - x.mean(), y - y.mean()
    scale = (dx * dy).sum() / (dx * dx).sum()
    return float(scale), float(y.mean() - scale * x.mean())


def chunked(x, y, size: int) -> Moments:
    parts = [compute_moments(x[i : i + size], y[i : i + size]) for i in range(0, len(x), size)]
    return reduce(merge_moments, parts, Moments())


@pytest.mark.parametrize("offset", [0.0, 100.0, 1e4])
@pytest.mark.parametrize("seed", range(3))
def test_chunked_fit_is_the_least_squares_line(offset: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    x = random.uniform(0, 1, 20_011) + offset
    y = 0.3 * (x - offset) + 0.05 + random.normal(0, 0.02, len(x))
    fit = solve(chunked(x, y, 997))
    scale, shift = exact_line(x, y)
    assert fit.status == "ok"
    assert fit.scale == pytest.approx(scale, rel=2e-15 * max(1.0, offset))
    assert fit.scale * offset + fit.shift == pytest.approx(scale * offset + shift, rel=1e-12)


def test_it_is_what_numpy_lstsq_finds() -> None:
    random = np.random.default_rng(7)
    x, y = random.uniform(0.1, 3, 5000), random.uniform(0.05, 0.9, 5000)
    matrix = np.stack([x, np.ones_like(x)], axis=1)
    expected, *_ = np.linalg.lstsq(matrix, y, rcond=None)
    fit = solve(chunked(x, y, 64))
    assert [fit.scale, fit.shift] == pytest.approx(list(expected), rel=1e-11)


def test_merging_is_the_same_for_any_chunk_size_and_empty_chunks() -> None:
    random = np.random.default_rng(1)
    x, y = random.normal(5, 2, 1000), random.normal(1, 1, 1000)
    whole = solve(compute_moments(x, y))
    for size in (1, 3, 100, 999, 5000):
        fit = solve(merge_moments(Moments(), merge_moments(chunked(x, y, size), Moments())))
        assert [fit.scale, fit.shift] == pytest.approx([whole.scale, whole.shift], rel=1e-12)


def test_a_falling_line_is_kept_and_called_inverted() -> None:
    fit = solve(compute_moments(np.array([1.0, 2.0, 3.0]), np.array([3.0, 2.0, 1.0])))
    assert (fit.scale, fit.shift, fit.status) == (-1.0, 4.0, "inverted")


def test_a_prediction_of_no_relation_is_degenerate() -> None:
    fit = solve(compute_moments(np.array([1.0, 2.0, 3.0]), np.array([1.0, 5.0, 1.0])))
    assert (fit.scale, fit.status) == (0.0, "degenerate")


@pytest.mark.parametrize("seed", range(8))
def test_rounding_does_not_decide_on_a_flat_wall(seed: int) -> None:
    x = np.random.default_rng(seed).uniform(0.2, 1, 10_000)
    flat = np.full(10_000, 1 / 3)
    assert solve(chunked(x, flat, 77)).status == "degenerate"
    slanted = flat * (1 + 1e-6 * x)  # a millimetre in a kilometre is a slope
    assert solve(chunked(x, slanted, 77)).status == "ok"


@pytest.mark.parametrize("value", [0.0, 0.1, 1e6])
def test_a_constant_prediction_is_degenerate_and_gives_the_mean_disparity(value: float) -> None:
    x = np.full(1000, np.float32(value)).astype(np.float64)
    y = np.random.default_rng(2).uniform(0.1, 1, 1000)
    fit = solve(chunked(x, y, 77))
    assert (fit.scale, fit.status) == (0.0, "degenerate")
    assert fit.shift == pytest.approx(y.mean(), rel=1e-14)


def test_small_but_real_variation_is_no_constant() -> None:
    x = np.linspace(1.0, 1.0 + 1e-6, 100)
    assert solve(compute_moments(x, np.linspace(0.1, 0.2, 100))).status == "ok"


def test_aligned_depth_is_never_beyond_the_floor() -> None:
    fit = solve(compute_moments(np.array([0.0, 1.0]), np.array([0.0, 1.0])))
    z, clamped = aligned_z(np.array([-1.0, 0.0, 0.25, 0.5]), fit, 0.25)
    assert z.tolist() == [4.0, 4.0, 4.0, 2.0]
    assert clamped.tolist() == [True, True, False, False]


def test_pairs_must_pair() -> None:
    with pytest.raises(ShapeError):
        compute_moments(np.zeros(3), np.zeros(4))
