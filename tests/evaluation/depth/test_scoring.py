"""One image's score: values worked out by hand, an independent reference, and laws."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from legoworld.cards import load_card
from legoworld.evaluation.depth import scoring
from legoworld.evaluation.depth.arrays import DepthArray, Space
from legoworld.evaluation.depth.protocol import depth_protocol, error_sums
from legoworld.evaluation.depth.rows import worse_than_constant
from legoworld.evaluation.depth.scoring import ImageScore, score_image
from legoworld.evaluation.pixels.resampling import SampledPrediction, sampler

PROTOCOL = depth_protocol(load_card("eth3d"))
Array = NDArray[Any]


def score(values: Array, truth: Array, space: Space = "depth") -> ImageScore:
    array = DepthArray(values=values, space=space, unit=None, intrinsics_px=None)
    size_wh = (truth.shape[1], truth.shape[0])
    return score_image(truth, sampler(array, size_wh, None), PROTOCOL)


def metric(result: ImageScore, name: str) -> dict[str, float]:
    assert result.metrics is not None
    return result.metrics[name]


def reference(disparity: Array, predicted: Array, truth: Array) -> dict[str, Any]:
    """MiDaS's compute_scale_and_shift, uncentred normal equations, then plain metrics."""
    valid = np.isfinite(truth) & (truth > 0)
    use = valid & predicted
    p, g, z = disparity[use], 1 / truth[use], truth[use]
    a_00, a_01, a_11 = np.sum(p * p), np.sum(p), float(use.sum())
    b_0, b_1 = np.sum(p * g), np.sum(g)
    det = a_00 * a_11 - a_01 * a_01
    s, t = (a_11 * b_0 - a_01 * b_1) / det, (-a_01 * b_0 + a_00 * b_1) / det
    deepest = truth[valid].max()
    aligned = s * p + t
    out = 1 / np.clip(aligned, 1 / deepest, None)
    n_holes = int(valid.sum() - use.sum())
    far = np.append(
        np.abs(out - z) / z, np.abs(deepest - truth[valid & ~predicted]) / truth[valid & ~predicted]
    )
    ratio = np.maximum(out / z, z / out)
    return {
        "s": s, "t": t, "clamped": int((aligned < 1 / deepest).sum()),
        "exclude": np.mean(np.abs(out - z) / z),
        "error_1": np.append(np.abs(out - z) / z, np.ones(n_holes)).mean(),
        "far": far.mean(),
        "delta1": np.mean(ratio < 1.25), "delta2": np.mean(ratio < 1.25**2),
        "rmse": np.sqrt(np.mean((out - z) ** 2)),
        "log10": np.mean(np.abs(np.log10(out) - np.log10(z))),
        "silog": np.std(np.log(out) - np.log(z)),
    }  # fmt: skip


def random_case(seed: int, shape: tuple[int, int] = (53, 71)) -> tuple[Array, Array]:
    """Predicted depth with holes, truth with 60 % inf and a few NaN, zeros and negatives."""
    random = np.random.default_rng(seed)
    truth = random.uniform(1.0, 40.0, shape)
    predicted = truth * random.uniform(0.5, 2.0, shape) * 3.0
    truth[random.random(shape) < 0.6] = np.inf
    truth.flat[:4] = [np.nan, 0.0, -1.0, -np.inf]
    predicted[random.random(shape) < 0.1] = np.inf
    predicted.flat[7:10] = [np.nan, 0.0, -2.0]
    return predicted, truth


def test_by_hand() -> None:
    # Disparity 3 and 1 on truth of 1 m, 1 on truth of 2 m: s = 1/6, t = 1/2, so z = 1 and 1.5.
    truth = np.array([[1.0] * 6 + [2.0] * 6])
    result = score(np.array([[3.0] * 3 + [1.0] * 9]), truth, "disparity")
    assert result.fit is not None
    assert [result.fit.scale, result.fit.shift] == pytest.approx([1 / 6, 1 / 2], rel=1e-14)
    assert result.fit.status == "ok"
    expected = {"error_1": 0.25, "exclude": 0.25, "far": 0.25}
    assert metric(result, "abs_rel") == pytest.approx(expected, rel=1e-14)
    assert metric(result, "delta1")["exclude"] == 0.25  # 4/3 and 3/2 are beyond 1.25
    assert metric(result, "delta2")["exclude"] == 1.0
    assert metric(result, "rmse_m")["exclude"] == pytest.approx(math.sqrt(0.1875), rel=1e-14)
    log10 = (3 * math.log10(1.5) + 6 * math.log10(4 / 3)) / 12
    assert metric(result, "log10")["exclude"] == pytest.approx(log10, rel=1e-14)
    logs = [0.0] * 3 + [math.log(1.5)] * 3 + [-math.log(4 / 3)] * 6
    assert metric(result, "silog")["exclude"] == pytest.approx(np.std(logs), rel=1e-13)
    # The constant: mean disparity 3/4 is 4/3 m, a third off everywhere.
    assert result.constant is not None
    assert result.constant["abs_rel"]["error_1"] == pytest.approx(1 / 3, rel=1e-14)


def test_holes_by_hand() -> None:
    # As above with four holes more, two on truth of 2 m (the deepest) and two on truth of 1 m.
    truth = np.array([[1.0] * 6 + [2.0] * 6 + [2.0] * 2 + [1.0] * 2])
    disparity = np.array([[3.0] * 3 + [1.0] * 9 + [np.nan] * 2 + [np.inf] * 2])
    result = score(disparity, truth, "disparity")
    assert result.counts.truth == 16
    assert result.counts.predicted == 12
    expected = {"error_1": (3 + 4) / 16, "exclude": 3 / 12, "far": (3 + 2 * 1.0) / 16}
    assert metric(result, "abs_rel") == pytest.approx(expected, rel=1e-14)
    assert metric(result, "delta1") == {"error_1": 3 / 16, "exclude": 3 / 12, "far": 5 / 16}
    assert metric(result, "delta3") == {"error_1": 12 / 16, "exclude": 1.0, "far": 14 / 16}
    assert set(metric(result, "rmse_m")) == {"exclude"}
    # The constant has no holes: mean disparity 3/4 on the 16, too, and 3/4 on the 12.
    assert result.constant is not None
    assert result.constant["abs_rel"] == pytest.approx(dict.fromkeys(expected, 1 / 3), rel=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_against_an_independent_reference(seed: int) -> None:
    predicted, truth = random_case(seed)
    on = np.isfinite(predicted) & (predicted > 0)
    expected = reference(np.where(on, 1 / np.where(on, predicted, 1), 0), on, truth)
    result = score(predicted, truth)
    assert result.fit is not None
    assert result.fit.scale == pytest.approx(expected["s"], rel=1e-9)
    assert result.fit.shift == pytest.approx(expected["t"], rel=1e-9)
    assert result.counts.clamped == expected["clamped"]
    for policy in ("exclude", "error_1", "far"):
        assert metric(result, "abs_rel")[policy] == pytest.approx(expected[policy], rel=1e-9)
    found = [metric(result, m)["exclude"] for m in ("delta1", "delta2", "rmse_m", "log10", "silog")]
    names = ("delta1", "delta2", "rmse", "log10", "silog")
    assert found == pytest.approx([expected[n] for n in names], rel=1e-9)


def test_the_clamp_is_met_and_counted() -> None:
    # One far outlier tilts the line: its own aligned disparity falls below 1 / max truth.
    truth = np.array([[1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9, 2.0]])
    values = 1 / truth
    values[0, -1] = -3.0
    result = score(values, truth, "disparity")
    assert result.counts.clamped == 1
    assert result.fit is not None
    assert result.fit.scale * -3.0 + result.fit.shift < 0.5
    assert metric(result, "abs_rel")["exclude"] < 0.5


def test_its_own_truth_scores_zero() -> None:
    _, truth = random_case(3)
    holes_free = np.where(np.isfinite(truth) & (truth > 0), truth, 5.0)
    result = score(holes_free, truth)
    assert metric(result, "abs_rel")["error_1"] < 1e-13
    assert metric(result, "delta1") == {"error_1": 1.0, "exclude": 1.0, "far": 1.0}
    assert metric(result, "rmse_m")["exclude"] < 1e-12
    assert metric(result, "silog")["exclude"] < 1e-7  # a difference of squares: root of 1e-16


@pytest.mark.parametrize(("factor", "offset"), [(250.0, 0.0), (1.0, 9.0), (-3.0, 2.0)])
def test_disparity_may_be_scaled_and_shifted(factor: float, offset: float) -> None:
    predicted, truth = random_case(11)
    predicted[~(np.isfinite(predicted) & (predicted > 0))] = np.nan
    disparity = 1 / predicted
    plain = score(disparity, truth, "disparity")
    moved = score(disparity * factor + offset, truth, "disparity")
    assert moved.metrics is not None
    assert plain.metrics is not None
    for name, values in plain.metrics.items():
        assert moved.metrics[name] == pytest.approx(values, rel=1e-9), name
    assert moved.counts == plain.counts
    assert moved.fit is not None
    assert moved.fit.status == ("ok" if factor > 0 else "inverted")


def test_the_unit_of_a_depth_does_not_matter() -> None:
    predicted, truth = random_case(12)
    plain, scaled = score(predicted, truth).metrics, score(predicted * 1000, truth).metrics
    assert plain is not None
    assert scaled is not None
    assert all(scaled[name] == pytest.approx(plain[name], rel=1e-9) for name in plain)


@pytest.mark.parametrize("seed", range(4))
def test_hole_policies_are_one_fit_and_bracket(seed: int) -> None:
    predicted, truth = random_case(seed)
    result = score(predicted, truth)
    values = metric(result, "abs_rel")
    hole_share = 1 - result.counts.predicted / result.counts.truth
    assert 0.05 < hole_share < 0.2
    mixed = values["exclude"] * (1 - hole_share) + hole_share
    assert values["error_1"] == pytest.approx(mixed, rel=1e-12)
    for name in ("delta1", "delta2", "delta3"):
        shares = metric(result, name)
        assert shares["error_1"] == pytest.approx(shares["exclude"] * (1 - hole_share), rel=1e-12)
        assert shares["error_1"] <= shares["far"]


def test_deleting_the_worst_pixels_gains_under_exclude_only() -> None:
    predicted, truth = random_case(5)
    valid = np.isfinite(truth) & (truth > 0) & np.isfinite(predicted) & (predicted > 0)
    ratio = np.zeros(truth.shape)
    ratio[valid] = predicted[valid] / 3 / truth[valid]
    ratio[valid] = np.maximum(ratio[valid], 1 / ratio[valid])
    cheated = np.where(ratio > np.quantile(ratio[valid], 0.9), np.inf, predicted)
    before, after = (
        metric(score(predicted, truth), "abs_rel"),
        metric(score(cheated, truth), "abs_rel"),
    )
    assert after["exclude"] < before["exclude"]
    assert after["error_1"] > before["error_1"]


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_a_disparity_given_as_a_depth_is_inverted_however_well_it_scores(offset: float) -> None:
    # The error alone does not tell: with the free shift it can be small, far below a constant's.
    truth = np.exp(np.random.default_rng(0).uniform(np.log(2), np.log(8), (40, 50)))
    result = score(1 / truth + offset, truth, "depth")
    assert result.fit is not None
    assert result.fit.status == "inverted"
    assert result.constant is not None
    assert metric(result, "abs_rel")["exclude"] < result.constant["abs_rel"]["exclude"]


def test_mostly_holes_is_worse_than_a_constant() -> None:
    predicted, truth = random_case(4)
    predicted[np.random.default_rng(0).random(truth.shape) < 0.9] = np.inf
    result = score(predicted, truth)
    assert result.metrics is not None
    assert result.constant is not None
    worse = worse_than_constant(result.metrics, result.constant)
    assert "error_1" in worse
    assert "exclude" not in worse


def test_a_constant_prediction_scores_as_the_constant() -> None:
    _, truth = random_case(2)
    result = score(np.full(truth.shape, 4.0, np.float32), truth)
    assert result.fit is not None
    assert result.fit.status == "degenerate"
    assert result.metrics == result.constant


@pytest.mark.parametrize(("n", "scored"), [(9, False), (10, True)])
def test_ten_predicted_pixels_are_enough(n: int, scored: bool) -> None:
    truth = np.linspace(1, 2, 40)[None, :]
    predicted = np.full((1, 40), np.inf)
    predicted[0, :n] = truth[0, :n]
    result = score(predicted, truth)
    assert (result.metrics is not None, result.counts.clamped) == (scored, 0)


def test_no_valid_truth_is_no_error() -> None:
    result = score(np.ones((5, 5)), np.full((5, 5), np.inf))
    assert (result.counts.truth, result.metrics, result.fit) == (0, None, None)


def test_the_band_size_does_not_change_the_score(monkeypatch: pytest.MonkeyPatch) -> None:
    predicted, truth = random_case(9)
    whole = score(predicted, truth).metrics
    monkeypatch.setattr(scoring, "_BAND_PX", 1)
    rows = score(predicted, truth).metrics
    assert whole is not None
    assert rows is not None
    assert all(rows[name] == pytest.approx(whole[name], rel=1e-12) for name in whole)


def test_a_ratio_on_the_threshold_is_no_hit() -> None:
    """Eigen et al. 2014: max(p / t, t / p) < 1.25^k, strictly."""
    bounds = np.array([1.25, 1.25**2, 1.25**3])
    for predicted, true in ((bounds, np.ones(3)), (1 / bounds, np.ones(3))):
        sums = error_sums(predicted, true, 1.25)
        assert (sums.delta1, sums.delta2, sums.delta3) == (0, 1, 2)


def test_a_band_without_truth_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    predicted, truth = random_case(11)
    truth[:3] = np.nan
    whole = score(predicted, truth)
    monkeypatch.setattr(scoring, "_BAND_PX", truth.shape[1])
    assert score(predicted, truth).counts == whole.counts
    assert whole.counts.truth > 0


def test_pixels_outside_of_the_prediction_s_view_are_counted() -> None:
    def sample(rows: Array, cols: Array) -> SampledPrediction:
        outside = cols >= 30
        values = np.where(outside, 0.0, 1.0 / (1 + cols))
        return SampledPrediction(values=values, predicted=~outside, outside=outside)

    truth = np.tile(1.0 + np.arange(40), (5, 1))
    assert score_image(truth, sample, PROTOCOL).counts == scoring.Counts(
        truth=200, predicted=150, outside=50
    )


def test_the_constant_under_exclude_is_of_the_predicted_pixels() -> None:
    truth = np.array([[1.0] * 10 + [3.0] * 10 + [5.0] * 10])
    disparity = np.array([[3.0, 1.0] * 10 + [np.nan] * 10])
    found = score(disparity, truth, "disparity").constant
    assert found is not None
    on_seen, on_all = (len(z) / sum(1 / x for x in z) for z in (truth[0, :20], truth[0]))
    exclude, whole = (
        float(np.mean(np.abs(z - truth[0, :n]) / truth[0, :n]))
        for z, n in ((on_seen, 20), (on_all, 30))
    )
    assert found["abs_rel"] == pytest.approx(
        {"exclude": exclude, "error_1": whole, "far": whole}, rel=1e-12
    )


@pytest.mark.parametrize(("above", "worse"), [(1.5e-9, ()), (2.5e-9, ("exclude",))])
def test_rounding_is_not_worse_than_the_constant(above: float, worse: tuple[str, ...]) -> None:
    zero = dict.fromkeys(("error_1", "exclude", "far"), 1.0)
    ours = zero | {"exclude": 1.0 + above}
    assert worse_than_constant({"abs_rel": ours}, {"abs_rel": zero}) == worse
