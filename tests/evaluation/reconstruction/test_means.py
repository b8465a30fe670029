"""Published rows of the benchmark's paper, and the rules they follow."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from legoworld.evaluation.bootstrap import draw_groups
from legoworld.evaluation.reconstruction.means import (
    compute_group_means,
    compute_mean,
    compute_means,
    headline,
    mean_and_sd,
)
from legoworld.records.reconstruction import ReconstructionRow

MEASURES = {m.name: m for m in headline(["F2"])}


def row(image_id=1, *, valid=True, r=1.0, a=1.0, family="f", tier="easy", environment="indoor"):
    r, a = (r, a) if valid else (0.0, 0.0)
    return ReconstructionRow(
        image_id=image_id, file_name=f"{image_id}.png", status="ok", code=None, reason=None,
        run_status="ok", warnings=(), family=family, environment=environment, theme=None,
        split=None, tier=tier, view=0, valid=valid, validity=None, R=r, A=a,
        S=None if a is None else (r + a) / 2, R_at={"F2": r}, objects=(), fov_error_deg=None,
        camera=None, diagnostics=None, appearance=None, flags=(),
    )  # fmt: skip


def shown(value):
    """As the paper prints it: percent with one digit."""
    return float(f"{100 * value:.1f}")


def cases(n, n_valid, r, a):
    """n cases, the first n_valid of them with these scores."""
    return [row(k, valid=k < n_valid, r=r, a=a, family=f"f{k}") for k in range(n)]


@pytest.mark.parametrize(
    ("v", "r", "a", "s"),
    [(1.0, 0.524, 0.544, 53.4), (1.0, 0.098, 0.198, 14.8)],
)
def test_s_of_valid_rows_is_half_of_r_and_a(v, r, a, s):
    found = compute_means(list(MEASURES.values()), cases(108, 108, r, a), None)
    assert found["V"].value == v
    assert shown(found["S"].value) == s


def test_the_table_mixes_two_averages_and_both_are_given():
    """Gen3DSR indoor: V 92.0, R 65.4 over the valid, A 0, S 30.1 over all = .92 x 65.4 / 2."""
    found = compute_means(list(MEASURES.values()), cases(100, 92, 0.654, 0.0), None)
    assert shown(found["V"].value) == 92.0
    assert shown(found["R_valid"].value) == 65.4
    assert shown(found["S"].value) == 30.1
    assert shown(found["R"].value) == 60.2
    assert (found["R"].n, found["R_valid"].n) == (100, 92)


def test_repeats_have_a_standard_deviation_with_ddof_1():
    mean, sd = mean_and_sd([0.9, 0.9, 1.0])
    assert (shown(mean), shown(sd)) == (93.3, 5.8)
    assert mean_and_sd([0.5]) == (0.5, None)
    assert mean_and_sd([1.0, 3.0]) == (2.0, pytest.approx(2**0.5))


def test_denominators_of_the_published_splits():
    """Office: 7 rooms x 3 tiers x 2 views = 42; indoor 108 and outdoor 90 + 10 aerial."""
    office = [
        row(100 * room + 10 * tier + view, family=f"office{room}", tier=name)
        for room in range(7) for tier, name in enumerate(("easy", "medium", "hard"))
        for view in range(2)
    ]  # fmt: skip
    groups = compute_group_means(list(MEASURES.values()), office, draws=10, seed=0)
    assert list(groups.tier) == ["easy", "medium", "hard"]
    assert {name: g.cases for name, g in groups.tier.items()} == dict.fromkeys(groups.tier, 14)
    assert len(office) == 42
    assert {g.families for g in groups.tier.values()} == {7}
    both = cases(108, 108, 0.5, 0.5) + [
        row(1000 + k, family=f"o{k}", environment="outdoor", tier=None if k >= 90 else "hard")
        for k in range(100)
    ]
    groups = compute_group_means(list(MEASURES.values()), both, draws=10, seed=0)
    assert {k: g.cases for k, g in groups.environment.items()} == {"indoor": 108, "outdoor": 100}
    assert groups.tier["unstated"].cases == 10


def test_tiers_are_weighted_by_their_inputs():
    """36 : 30: the mean over all is that of inputs, not of tiers."""
    rows = [row(k, r=0.2, a=0.2, tier="easy") for k in range(36)]
    rows += [row(36 + k, r=0.8, a=0.8, tier="hard") for k in range(30)]
    expected = (36 * 0.2 + 30 * 0.8) / 66
    assert compute_mean(MEASURES["S"], rows).value == pytest.approx(expected)


def test_families_are_drawn_whole():
    rows = [row(k, r=float(k // 6), a=0.0, family=f"f{k // 6}") for k in range(12)]
    draws = draw_groups([r.family for r in rows], 2000, 0)
    samples = draws.means(np.array([r.R for r in rows]), [r.family for r in rows])
    assert set(np.round(samples, 6)) == {0.0, 0.5, 1.0}
    assert compute_mean(MEASURES["R"], rows, draws).interval.ends == (0.0, 1.0)
    assert compute_mean(MEASURES["R"], rows, draws).interval.unit == "family"


def test_a_single_family_has_no_interval():
    rows = [row(k, r=k / 10) for k in range(6)]
    draws = draw_groups([r.family for r in rows], 100, 0)
    assert compute_mean(MEASURES["R"], rows, draws).interval is None


def test_a_conditional_mean_weights_families_by_their_valid_cases():
    rows = [row(1, r=1.0, family="a"), row(2, valid=False, family="a"), row(3, r=0.5, family="b")]
    draws = draw_groups([r.family for r in rows], 500, 0)
    found = compute_mean(MEASURES["R_valid"], rows, draws)
    assert (found.value, found.n) == (0.75, 2)
    assert found.interval.ends == (0.5, 1.0)


def test_a_case_that_is_not_valid_is_zero_at_every_tolerance():
    rows = [row(1, r=0.5, a=0.5), replace(row(2, valid=False), R_at={"F2": 0.9})]
    found = compute_means(list(MEASURES.values()), rows, None)
    assert (found["F2"].value, found["R"].value, found["R_valid"].value) == (0.25, 0.25, 0.5)
    assert (found["F2"].n, found["R_valid"].n) == (2, 1)


def test_a_case_without_a_render_leaves_a_and_s_undefined():
    rows = [row(1), replace(row(2), A=None, S=None)]
    found = compute_means(list(MEASURES.values()), rows, None)
    assert found["A"].value is found["S"].value is None
    assert found["R"].value == 1.0
