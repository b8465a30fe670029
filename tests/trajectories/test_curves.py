"""Laws of Q over time, on rows made by hand and drawn."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from legoworld.records.base import UNSET
from legoworld.records.trajectories import CAUSES, Moment, ScoredScene
from legoworld.trajectories.curves import (
    TIE,
    Trajectory,
    axis_share,
    drops,
    list_edits,
    moments,
    q_at,
    score_trajectory,
)
from legoworld.trajectories.score_checkpoints import _scored_scene
from legoworld.trajectories.tables import SHARES, agent_tables, common_images


def scene(ordinal, r, a, *, camera="c", snapshot=None, share=None):
    share = (ordinal or 100) / 100 if share is None else share
    when = Moment(at_s=share * 60, wall_share=share, calls_share=share, tokens_share=None)
    q = None if r is None or a is None else (r + a) / 2
    return ScoredScene(
        ordinal=ordinal, call=ordinal or 100, when=when, R=r, A=a, Q=q,
        camera_sha256=camera, snapshot_sha256=snapshot or f"s{r}",
    )  # fmt: skip


def trial(checkpoints, final=None, **about):
    known = {"image_id": 1, "scene": "x", "family": "f", "agent": "a", "run": 1, "seconds": 60.0}
    last = checkpoints[-1] if checkpoints else scene(1, None, None)
    final = final or scene(
        None, last.R, last.A, camera=last.camera_sha256, snapshot=last.snapshot_sha256
    )
    return score_trajectory(Trajectory(checkpoints=checkpoints, final=final, **(known | about)))


SCENES = st.lists(
    st.tuples(
        st.none() | st.floats(0, 1), st.floats(0, 1), st.sampled_from("cd"), st.sampled_from("st")
    ),
    max_size=12,
)


def drawn_rows(rows):
    return [
        scene(n, r, None if r is None else a, camera=c, snapshot=s)
        for n, (r, a, c, s) in enumerate(rows, start=1)
    ]


def test_a_deliberate_regression_is_found_with_its_call_and_its_regret():
    made = trial([scene(1, 0.2, 0.4), scene(2, 0.6, 0.6), scene(3, 0.3, 0.5), scene(4, 0.5, 0.5)])
    (drop,) = drops(made)
    assert (drop.before, drop.after, drop.call) == (2, 3, 3)
    assert drop.d_q == pytest.approx(-0.2)
    assert (made.n_lowering, len(made.edits)) == (1, 3)
    assert made.best == 2
    assert made.regret == pytest.approx(0.1)
    assert made.first is not None
    assert made.first.at_s == pytest.approx(0.6)


@given(SCENES)
def test_regret_is_never_negative_and_its_parts_are_all_of_it(rows):
    made = trial(drawn_rows(rows))
    assert made.regret >= 0
    assert sum(made.regret_split.values()) == pytest.approx(made.regret, abs=1e-12)
    assert set(made.regret_split) == set(CAUSES)


@given(SCENES)
def test_edits_tell_the_way_from_the_first_scene_to_the_last(rows):
    made = trial(drawn_rows(rows))
    eligible = [s for s in made.scenes if s.Q is not None]
    if eligible:
        assert sum(e.d_q for e in made.edits) == pytest.approx(eligible[-1].Q - eligible[0].Q)
    for edit in made.edits:
        assert edit.d_q == pytest.approx((edit.d_r + edit.d_a) / 2)
        assert sum(edit.cause.values()) == pytest.approx(edit.d_q, abs=1e-12)
        assert edit.cause["validity"] == 0


@given(SCENES, st.integers(0, 12))
def test_an_ineligible_scene_between_changes_nothing_but_its_count(rows, at):
    scenes = drawn_rows(rows)
    more = [*scenes[:at], scene(50, None, None), *scenes[at:]]
    before, after = list_edits(scenes), list_edits(more)
    assert [e.d_q for e in before] == [e.d_q for e in after]
    assert sum(e.skipped for e in after) - sum(e.skipped for e in before) in (0, 1)


def test_an_invalid_submission_counts_as_zero_and_its_regret_is_validity_s():
    made = trial([scene(1, 0.4, 0.6)], final=scene(None, None, None))
    assert (made.final_valid, made.final_q) == (False, 0.0)
    assert made.regret == pytest.approx(0.5)
    assert made.regret_split["validity"] == pytest.approx(0.5)


@pytest.mark.parametrize("change", [0.1, TIE / 2, 0.0, -TIE / 2, -TIE * 1.5])
def test_a_scene_is_lower_by_more_than_the_tie(change):
    lower = int(change < -TIE)
    both = trial([scene(1, 0.5, 0.5), scene(2, 0.5 + change, 0.5 + change)])
    counts = both.n_lowering, both.n_lowering_r, both.n_lowering_a
    assert counts == (lower, lower, lower)
    assert len(drops(both)) == lower
    r = trial([scene(1, 0.5, 0.5), scene(2, 0.5 + change, 0.6)])
    assert (r.n_lowering, r.n_lowering_r, r.n_lowering_a) == (0, lower, 0)
    a = trial([scene(1, 0.5, 0.5), scene(2, 0.6, 0.5 + change)])
    assert (a.n_lowering, a.n_lowering_r, a.n_lowering_a) == (0, 0, lower)


def case(**said):
    known = {"status": "ok", "valid": True, "R": 0.4, "A": 0.6, "reason": None, "validity": None}
    return SimpleNamespace(**(known | said))


READ = SimpleNamespace(camera=UNSET, snapshot_sha256="s")
CHECK = {"a": SimpleNamespace(ok=True, found="x"), "b": SimpleNamespace(ok=False, found="none"),
         "c": SimpleNamespace(ok=False, found="two")}  # fmt: skip


@pytest.mark.parametrize(
    ("row", "q", "reason"),
    [
        (case(), 0.5, ""),
        (case(A=None), None, "ok"),
        (case(R=None, reason="no surface"), None, "no surface"),
        (case(valid=False, validity=CHECK), None, "b: none; c: two"),
        (case(status="failed"), None, "failed"),
        (case(status="failed", reason="it broke"), None, "it broke"),
    ],
)
def test_a_scene_is_eligible_with_both_scores(row, q, reason):
    when = Moment(at_s=1, wall_share=0, calls_share=0, tokens_share=None)
    made = _scored_scene(SimpleNamespace(ordinal=3, call=7), when, READ, row)
    assert (made.ordinal, made.call, made.when, made.reason) == (3, 7, when, reason)
    assert ((0.4, 0.6, q) if q else (None, None, None)) == (made.R, made.A, made.Q)
    assert (made.camera_sha256, made.snapshot_sha256) == (None, "s")
    submitted = _scored_scene(None, when, READ, row)
    assert (submitted.ordinal, submitted.call) == (None, 0)


def test_a_change_below_the_tie_is_no_drop():
    made = trial([scene(1, 0.5, 0.5), scene(2, 0.5 - TIE / 2, 0.5)])
    assert made.n_lowering == 0
    assert len(made.edits) == 1


@pytest.mark.parametrize(
    ("after", "cause"),
    [
        (scene(2, 0.3, 0.5, camera="moved", snapshot="s"), "camera"),
        (scene(2, 0.3, 0.5, snapshot="t"), "geometry"),
        (scene(2, 0.5, 0.3, snapshot="s"), "appearance"),
        (scene(2, 0.3, 0.3, snapshot="t"), "geometry"),
    ],
)
def test_what_changed_alone_is_the_cause(after, cause):
    (edit,) = trial([scene(1, 0.5, 0.5, snapshot="s"), after]).edits
    assert edit.cause[cause] == pytest.approx(edit.d_q)


def test_a_new_wall_that_is_better_in_place_and_worse_in_colour_is_split():
    (edit,) = trial([scene(1, 0.5, 0.5, snapshot="s"), scene(2, 0.7, 0.4, snapshot="t")]).edits
    assert edit.cause["geometry"] == pytest.approx(0.1)
    assert edit.cause["appearance"] == pytest.approx(-0.05)


def test_a_submission_other_than_the_last_checkpoint_is_an_edit_of_its_own():
    """It saved, and then went on."""
    made = trial([scene(1, 0.6, 0.6), scene(2, 0.9, 0.9)], final=scene(None, 0.6, 0.6))
    assert [(e.before, e.after) for e in made.edits] == [(1, 2), (2, None)]
    assert made.regret == pytest.approx(0.3)
    assert made.regret_split["geometry"] == pytest.approx(0.3)


@given(SCENES)
def test_the_curve_is_zero_first_and_the_submission_last(rows):
    made = trial(drawn_rows(rows))
    assert q_at(made, "wall", 0.0) == 0.0
    assert q_at(made, "wall", 1.0) == made.final_q
    assert q_at(made, "calls", 0.5) == q_at(made, "wall", 0.5)
    assert q_at(made, "tokens", 0.5) is (None if rows else 0.0) or not rows


def test_each_axis_is_its_own_share():
    made = trial([scene(1, 0.2, 0.4), scene(2, 0.5, 0.7), scene(3, None, None), scene(4, 0.9, 0.9)])
    places = [(0.25, 0.5, 0.75), (0.5, 0.75, 0.8), (0.6, 0.8, 0.85), (0.75, 0.9, 0.95), (1, 1, 1)]
    scenes = [
        replace(s, when=Moment(at_s=1, wall_share=w, calls_share=c, tokens_share=t))
        for s, (w, c, t) in zip(made.scenes, places, strict=True)
    ]
    made = replace(made, scenes=tuple(scenes))
    for k, axis in enumerate(("wall", "calls", "tokens")):
        assert [axis_share(s.when, axis) for s in scenes] == [place[k] for place in places]
        first, second, third = (places[n][k] for n in (0, 1, 3))
        assert q_at(made, axis, first - 0.01) == 0.0
        assert q_at(made, axis, first) == pytest.approx(0.3)
        assert q_at(made, axis, second - 0.01) == pytest.approx(0.3)
        assert q_at(made, axis, second) == pytest.approx(0.6)
        assert q_at(made, axis, third - 0.01) == pytest.approx(0.6), "an ineligible one is passed"
        assert q_at(made, axis, third) == pytest.approx(0.9)


def test_moments_are_shares_of_time_calls_and_tokens():
    found = moments(
        [6.0, 30.0, 60.0], [1, 4, 8], seconds=60.0, n_calls=8, tokens=[(1, 100), (5, 300), (8, 400)]
    )
    assert [m.wall_share for m in found] == [0.1, 0.5, 1.0]
    assert [m.calls_share for m in found] == [0.125, 0.5, 1.0]
    assert [m.tokens_share for m in found] == [0.25, 0.25, 1.0]
    assert moments([1.0], [1], seconds=2.0, n_calls=2, tokens=[])[0].tokens_share is None


def test_common_tasks_are_those_that_every_agent_left_something_of():
    good, none = [scene(1, 0.5, 0.5)], [scene(1, None, None)]
    trials = [
        trial(good, agent="a", image_id=1), trial(good, agent="a", image_id=2),
        trial(none, agent="b", image_id=1), trial(good, agent="b", image_id=2),
    ]  # fmt: skip
    assert common_images(trials) == (2,)
    a, b = agent_tables(trials, draws=100, seed=0)
    assert (a.n_trials, a.n_evaluable, b.n_evaluable) == (2, 2, 1)
    assert b.means["final_q"].value == pytest.approx(0.25)
    assert b.means["first_s"].n == 1
    assert len(a.curves["wall"]) == len(SHARES)


def test_families_are_resampled_whole():
    """Nine trials of one family and one of another: the interval is between their two means."""
    trials = [trial([scene(1, 0.0, 0.0)], family="f", image_id=n) for n in range(9)]
    trials.append(trial([scene(1, 1.0, 1.0)], family="g", image_id=10))
    (table,) = agent_tables(trials, draws=400, seed=0)
    found = table.means["final_q"]
    assert found.value == pytest.approx(0.1)
    assert found.interval is not None
    assert (found.interval.low, found.interval.high) == (0.0, 1.0)
    assert agent_tables(trials, draws=400, seed=0) == (table,)


def test_each_mean_is_of_its_own_field():
    made = trial([scene(1, 0.2, 0.4), scene(2, 0.5, 0.7)])
    first = Moment(at_s=3.0, wall_share=0.25, calls_share=0.5, tokens_share=0.75)
    split = {cause: 10.0 + n for n, cause in enumerate(CAUSES)}
    made = replace(
        made, final_q=0.5, best_q=0.75, regret=0.25, first=first, picked_q=0.375, edits=(0,) * 8,
        n_lowering=1, n_lowering_r=2, n_lowering_a=3, regret_split=split,
    )  # fmt: skip
    (table,) = agent_tables([made, made], draws=10, seed=0)
    assert {name: mean.value for name, mean in table.means.items()} == {
        "final_q": 0.5, "best_q": 0.75, "regret": 0.25, "lowering_share": 0.125,
        "lowering_r_share": 0.25, "lowering_a_share": 0.375, "first_s": 3.0,
        "first_wall_share": 0.25, "first_calls_share": 0.5, "first_tokens_share": 0.75,
        "picked_q": 0.375, **{f"regret_{cause}": value for cause, value in split.items()},
    }  # fmt: skip
    assert {mean.n for mean in table.means.values()} == {2}
    assert (table.agent, table.n_trials, table.n_evaluable) == ("a", 2, 2)
    none = replace(made, first=None, best_q=None, edits=(), picked_q=None)
    (table,) = agent_tables([made, none], draws=10, seed=0)
    alone = {name for name, mean in table.means.items() if mean.n == 1}
    assert alone == {
        "best_q", "regret", "lowering_share", "lowering_r_share", "lowering_a_share", "first_s",
        "first_wall_share", "first_calls_share", "first_tokens_share", "picked_q",
    }  # fmt: skip
    assert (table.n_trials, table.n_evaluable) == (2, 1)
    assert len(table.curves["wall"]) == len(SHARES)
    (table,) = agent_tables([none], draws=10, seed=0)
    assert (table.means["best_q"].value, table.means["best_q"].n) == (None, 0)
