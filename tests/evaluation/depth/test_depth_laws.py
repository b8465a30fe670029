"""Laws of the depth score over any pictures: what may not change it, what may only worsen it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from legoworld.cards import load_card
from legoworld.evaluation.depth.arrays import DepthArray
from legoworld.evaluation.depth.protocol import HOLE_POLICIES, depth_protocol
from legoworld.evaluation.depth.scoring import ImageScore, score_image
from legoworld.evaluation.pixels.resampling import bilinear, sampler

Array = NDArray[np.float64]
PROTOCOL = depth_protocol(load_card("eth3d"))
EVERY = [
    *((m, p) for m in ("abs_rel", "delta1", "delta2", "delta3") for p in HOLE_POLICIES),
    *((m, "exclude") for m in ("rmse_m", "log10", "silog")),
]


def disparity_of(values: Array) -> DepthArray:
    return DepthArray(values=values, space="disparity", unit=None, intrinsics_px=None)


def scored(truth_z_m: Array, disparity: Array) -> ImageScore:
    height, width = truth_z_m.shape
    sample = sampler(disparity_of(disparity), (width, height), None)
    return score_image(truth_z_m, sample, PROTOCOL)


def metrics(truth_z_m: Array, disparity: Array) -> dict[tuple[str, str], float]:
    score = scored(truth_z_m, disparity)
    assert score.metrics is not None
    return {(m, p): score.metrics[m][p] for m, p in EVERY}


@st.composite
def pictures(draw: st.DrawFn) -> tuple[Array, Array]:
    """A truth with gaps, and a noisy disparity of it with holes; both about 8 m deep."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    height, width = draw(st.integers(5, 24)), draw(st.integers(5, 24))
    truth = random.uniform(0.5, 8, (height, width))
    disparity = 1 / truth + random.normal(0, draw(st.sampled_from([1e-3, 0.05])), truth.shape)
    truth[random.random(truth.shape) < draw(st.sampled_from([0.0, 0.3]))] = np.inf
    disparity[random.random(truth.shape) < draw(st.sampled_from([0.0, 0.2]))] = np.nan
    truth.flat[:10], disparity.flat[:10] = 1 + np.arange(10) / 3, 3 - np.arange(10) / 4
    return truth, disparity


LAW = settings(max_examples=80)


@LAW
@given(pictures(), st.floats(0.01, 100), st.floats(-50, 50))
def test_scale_and_shift_of_a_disparity_say_nothing(
    pair: tuple[Array, Array], scale: float, shift: float
) -> None:
    truth, disparity = pair
    ours, moved = metrics(truth, disparity), metrics(truth, scale * disparity + shift)
    for key, value in ours.items():
        # A pixel at a delta's very threshold may fall either way.
        slack = 1.5 / truth.size if key[0].startswith("delta") else 1e-7 * (1 + abs(value))
        assert moved[key] == pytest.approx(value, abs=slack)


@LAW
@given(pictures(), st.floats(0.01, 100))
def test_the_unit_of_the_truth_says_nothing_but_to_rmse(
    pair: tuple[Array, Array], scale: float
) -> None:
    truth, disparity = pair
    ours, other = metrics(truth, disparity), metrics(truth * scale, disparity)
    for key, value in ours.items():
        expected = value * scale if key[0] == "rmse_m" else value
        slack = 1.5 / truth.size if key[0].startswith("delta") else 1e-7 * (1 + abs(expected))
        assert other[key] == pytest.approx(expected, abs=slack)


@LAW
@given(pictures())
def test_a_truth_given_back_scores_nothing_but_its_holes(pair: tuple[Array, Array]) -> None:
    truth, disparity = pair
    holes = np.isnan(disparity)
    perfect = np.where(np.isfinite(truth) & ~holes, 1 / truth, np.nan)
    found = metrics(truth, perfect)
    share = float(holes[np.isfinite(truth)].mean())
    assert found["abs_rel", "exclude"] < 1e-9
    assert found["abs_rel", "error_1"] == pytest.approx(share, abs=1e-9)
    assert found["delta1", "error_1"] == pytest.approx(1 - share)
    assert found["abs_rel", "error_1"] >= found["abs_rel", "exclude"]


@LAW
@given(pictures(), st.integers(0, 2**32 - 1))
def test_more_holes_in_a_perfect_prediction_never_help(
    pair: tuple[Array, Array], seed: int
) -> None:
    truth, disparity = pair
    perfect = np.where(np.isfinite(truth), 1 / truth, np.nan)
    perfect[np.isnan(disparity)] = np.nan
    more = perfect.copy()
    more[np.random.default_rng(seed).random(truth.shape) < 0.3] = np.nan
    more.flat[:10] = perfect.flat[:10]
    before, after = metrics(truth, perfect), metrics(truth, more)
    for policy in ("error_1", "far"):
        assert after["abs_rel", policy] >= before["abs_rel", policy] - 1e-9
        assert after["delta1", policy] <= before["delta1", policy] + 1e-12


@LAW
@given(pictures())
def test_the_bounds_stand_in_their_order(pair: tuple[Array, Array]) -> None:
    found = metrics(*pair)
    for policy in HOLE_POLICIES:
        deltas = [found[f"delta{k}", policy] for k in (1, 2, 3)]
        assert 0 <= deltas[0] <= deltas[1] <= deltas[2] <= 1
    for k in (1, 2, 3):
        assert found[f"delta{k}", "error_1"] <= found[f"delta{k}", "far"] + 1e-12
        assert found[f"delta{k}", "error_1"] <= found[f"delta{k}", "exclude"] + 1e-12


@LAW
@given(pictures())
def test_turning_and_mirroring_both_pictures_changes_nothing(pair: tuple[Array, Array]) -> None:
    truth, disparity = pair
    ours = metrics(truth, disparity)
    for turn in (np.flipud, np.fliplr, np.transpose, np.rot90):
        turned = metrics(np.ascontiguousarray(turn(truth)), np.ascontiguousarray(turn(disparity)))
        for key, value in ours.items():
            slack = 1.5 / truth.size if key[0].startswith("delta") else 1e-9 * (1 + abs(value))
            assert turned[key] == pytest.approx(value, abs=slack)


@LAW
@given(pictures(), st.integers(0, 2**32 - 1))
def test_bilinear_stays_between_its_neighbours(pair: tuple[Array, Array], seed: int) -> None:
    _, disparity = pair
    height, width = disparity.shape
    xy = np.random.default_rng(seed).uniform(-1, 1 + max(width, height), (200, 2))
    found = bilinear(disparity_of(disparity), xy)
    assert np.all(np.isfinite(found.values))
    assert not np.any(found.predicted & found.outside)
    low, high = np.nanmin(disparity), np.nanmax(disparity)
    inside = found.values[found.predicted]
    assert np.all((inside >= low - 1e-12) & (inside <= high + 1e-12))
    beyond = (xy[:, 0] > width + 1e-3) | (xy[:, 1] > height + 1e-3) | (xy < -1e-3).any(axis=1)
    assert np.all(found.outside[beyond])


@LAW
@given(
    st.integers(2, 12), st.integers(2, 12), st.integers(1, 4), st.floats(-3, 3), st.floats(-3, 3)
)
def test_a_plane_in_disparity_is_resampled_to_itself(
    width: int, height: int, factor: int, slope_x: float, slope_y: float
) -> None:
    """Away from the half pixel at the edges, where neighbours run out."""
    y, x = np.mgrid[:height, :width] + 0.5
    small = slope_x * x + slope_y * y + 1
    rows, cols = (a.ravel() for a in np.mgrid[: height * factor, : width * factor])
    sample = sampler(disparity_of(small), (width * factor, height * factor), None)
    found = sample(rows, cols)
    u, v = (cols + 0.5) / factor, (rows + 0.5) / factor
    inner = (u >= 0.5) & (u <= width - 0.5) & (v >= 0.5) & (v <= height - 0.5)
    expected = slope_x * u + slope_y * v + 1
    assert found.predicted.all()
    np.testing.assert_allclose(found.values[inner], expected[inner], rtol=0, atol=1e-10)
