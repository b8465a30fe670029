"""Pairs of checkpoints by their gap, and what judges say of them."""

from __future__ import annotations

import json
from collections import Counter

import pytest

from legoworld import bench_judges, cli
from legoworld.errors import UsageError
from legoworld.evaluation.reconstruction.judge_pairs import (
    TrajectoryScoresError,
    choose_pairs,
    pair_scores,
)
from legoworld.evaluation.reconstruction.judges import JudgementsError, judge_agreement
from legoworld.records.base import readable
from legoworld.records.trajectories import Moment, ScoredScene, TrajectoryFile
from legoworld.trajectories.curves import Trajectory, score_trajectory

WHEN = Moment(at_s=1.0, wall_share=0.1, calls_share=0.1, tokens_share=None)


def scene(ordinal, r=None, a=None):
    return ScoredScene(
        ordinal=ordinal, call=ordinal or 0, when=WHEN, R=r, A=a,
        Q=None if r is None else (r + a) / 2,
    )  # fmt: skip


def trial(values, final, *, agent="a", name="kitchen", run=1):
    """values: (R, A) of each checkpoint, None for one that is not eligible."""
    return score_trajectory(
        Trajectory(
            image_id=1, scene=name, family=name, agent=agent, run=run, seconds=9.0,
            checkpoints=[scene(n, *(v or ())) for n, v in enumerate(values, start=1)],
            final=scene(None, *(final or ())),
        )
    )  # fmt: skip


def document(*trials):
    return TrajectoryFile(
        schema_version=1, legoworld="0", evaluator={}, draws=1, seed=0, shares=(1.0,),
        trials=trials, agents=(), common=None, common_images=(),
    )  # fmt: skip


def names(pairs):
    return sorted((pair.gap, *sorted(pair.shown)) for pair in pairs)


def test_gaps_count_edits_between_eligible_scenes():
    """Checkpoint 2 is not eligible: 1 and 3 are one edit apart; the submission is a scene more."""
    file = document(trial([(0.1, 0.1), None, (0.2, 0.2), (0.3, 0.3)], (0.4, 0.4)))
    assert names(choose_pairs(file, 0)) == [
        ("1-2", "1", "3"), ("1-2", "1", "4"), ("1-2", "3", "4"), ("1-2", "3", "final"),
        ("1-2", "4", "final"), ("3-5", "1", "final"),
    ]  # fmt: skip
    same = document(trial([(0.1, 0.1), (0.2, 0.2)], (0.2, 0.2)))
    assert names(choose_pairs(same, 0)) == [("1-2", "1", "2")]
    assert "final" not in pair_scores(same)
    nothing = document(trial([None, (0.1, 0.1)], None), trial([], (0.5, 0.5), agent="b"))
    assert choose_pairs(nothing, 0) == []


@pytest.mark.parametrize(
    ("length", "counts"),
    [(6, (9, 6, 0)), (7, (11, 9, 1)), (12, (20, 20, 20)), (30, (20, 20, 20))],
)
def test_twenty_of_each_gap(length, counts):
    """n scenes have n - g pairs at gap g: 7 have 6 + 5, 4 + 3 + 2 and 1."""
    values = [(n / 100, 0.5) for n in range(length)]
    pairs = choose_pairs(document(trial(values, values[-1])), 0)
    found = Counter(pair.gap for pair in pairs)
    assert tuple(found[gap] for gap in ("1-2", "3-5", ">=6")) == counts
    bounds = {"1-2": (1, 2), "3-5": (3, 5), ">=6": (6, 99)}
    for pair in pairs:
        low, high = bounds[pair.gap]
        assert low <= abs(int(pair.shown[0]) - int(pair.shown[1])) <= high
    assert len({(pair.item, frozenset(pair.shown)) for pair in pairs}) == len(pairs)


def test_the_choice_is_the_seeds_and_the_builders_own():
    def of(agent, name):
        return trial([(n / 100, 0.5) for n in range(30)], None, agent=agent, name=name)

    both = choose_pairs(document(of("a", "x"), of("b", "x"), of("b", "y")), 3)
    assert [p for p in both if p.builder == "a"] == choose_pairs(document(of("a", "x")), 3)
    assert both != choose_pairs(document(of("a", "x"), of("b", "x"), of("b", "y")), 4)
    first = Counter(int(p.shown[0]) < int(p.shown[1]) for p in both)
    assert min(first.values()) > 30, "which is shown first is drawn"
    assert {p.item for p in both if p.builder == "b"} == {"b/run_1/x", "b/run_1/y"}


#: Four scenes: R falls at the second, A is level but for 9e-7, all of it at gaps of 1 to 3.
SCORED = document(trial([(0.5, 0.4), (0.2, 0.4 + 9e-7), (0.6, 0.5), (0.6, 0.7)], (0.6, 0.7)))


def said(pair, chosen, *, judge="j", aspect="reconstruction", swapped=False):
    shown = pair.shown[::-1] if swapped else pair.shown
    return {"builder": pair.builder, "item": pair.item, "shown": shown, "judge": judge,
            "aspect": aspect, "chosen": chosen}  # fmt: skip


def agreement(tmp_path, lines):
    path = tmp_path / "j.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return judge_agreement(path, pair_scores(SCORED), {}, choose_pairs(SCORED, 0))


def test_directions_ties_and_pairs_left_out(tmp_path):
    by_names = {frozenset(pair.shown): pair for pair in choose_pairs(SCORED, 0)}

    def pair(one, other):
        return by_names[frozenset({one, other})]

    assert len(by_names) == 6
    lines = [
        said(pair("1", "2"), "1"),  # right: .5 before .2
        said(pair("3", "4"), "tie"),  # right: .6 both
        said(pair("1", "3"), "both_bad"),  # wrong
        said(pair("1", "4"), "4"),  # right, at a gap of 3
        said(pair("1", "4"), "1", swapped=True),  # for the audit alone
        said(pair("2", "3"), "3", swapped=True),  # its own order was not asked: failed
        said(pair("1", "2"), None, aspect="appearance"),  # right: within 1e-6
    ]
    found = agreement(tmp_path, lines)
    assert found.judgements == 7
    r = found.aspects["reconstruction"]
    cell = r.matrix["a"]["j"]
    assert (cell.agreed, cell.n, cell.ties, cell.both_bad, cell.failed) == (3, 6, 1, 1, 2)
    assert cell.score_ties == 1
    assert {gap: (c.agreed, c.n) for gap, c in r.by_gap.items()} == {"1-2": (2, 5), "3-5": (1, 1)}
    assert (r.order_swaps["j"].swapped, r.order_swaps["j"].consistent) == (1, 0)
    a = found.aspects["appearance"].matrix["a"]["j"]
    assert (a.agreed, a.n, a.failed, a.score_ties) == (1, 6, 5, 1)


def test_what_was_not_asked_or_asked_twice_is_refused(tmp_path):
    pair = choose_pairs(SCORED, 0)[0]
    good = said(pair, "tie")
    for line, why in [
        (good, "a second time"),
        (good | {"shown": ["1", "9"]}, "none of the chosen pairs"),
        (good | {"builder": "b"}, "none of the chosen pairs"),
    ]:
        with pytest.raises(JudgementsError, match=why):
            agreement(tmp_path, [good, line])
    twice = document(trial([], None), trial([], None))
    with pytest.raises(TrajectoryScoresError, match="same agent, run and scene"):
        pair_scores(twice)


def test_the_command(tmp_path, capsys):
    scores = tmp_path / "scores"
    scores.mkdir()
    judgements = tmp_path / "j.jsonl"
    judgements.write_text(json.dumps(said(choose_pairs(SCORED, 2)[0], "both_bad")) + "\n")
    asked = ["bench", "judges", str(judgements), "--trajectories", str(scores), "--seed", "2"]
    assert cli.run(asked) == 2
    assert "trajectories.json" in capsys.readouterr().err
    (scores / "trajectories.json").write_text(readable(SCORED))
    assert cli.run(asked) == 0
    out = capsys.readouterr().out
    assert "6 judgements: 0 ties, 1 both_bad, 5 failed; the score ties in 1" in out
    assert "gap 1-2: 0.0 of 5\ngap 3-5: 0.0 of 1" in out
    found = bench_judges(judgements, trajectories=scores, seed=2)
    assert list(found.evidence_sha256) == ["trajectories.json"]
    with pytest.raises(UsageError, match="two sources"):
        bench_judges(judgements, [scores], trajectories=scores)
