"""`bench table`: ranks, paired differences and the cost frontier of N systems."""

from __future__ import annotations

import json

import numpy as np
import pytest
from evaluation.reconstruction.datasets import Submission, evaluate_bench, write_dataset, write_run

from legoworld import cli
from legoworld.api.bench import bench_table
from legoworld.comparison.make_comparison import make_comparison
from legoworld.comparison.standings import STANDARD, _cost, _on_frontier
from legoworld.records.agents import Usage
from legoworld.records.comparison import ComparisonSettings

USAGE = {"prompt_tokens": 1000, "cached_tokens": 400, "completion_tokens": 50}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Three systems: a (with one missing), b (nearer by much), and c, which is b again."""
    root = tmp_path_factory.mktemp("standings")
    dataset = write_dataset(root / "dataset", families=3)
    far = {i: Submission(depth_z_m=c.depth_z_m * np.float32(1.045 + 0.01 * i))
           for i, c in dataset.cases.items()}  # fmt: skip
    systems = {
        "a": ({1: Submission(status="missing")}, {**USAGE, "cost_usd": 0.5}),
        "b": (far, USAGE),
        "c": (far, {"prompt_tokens": "many"}),
    }
    made = {}
    for name, (submissions, usage) in systems.items():
        run = write_run(root / f"run-{name}", dataset, submissions,
                        agent={"agent": name, "model": "m", "usage": usage})  # fmt: skip
        if name == "a":  # the missing scene has no provenance.json
            document = json.loads((run / "run.json").read_text("utf-8"))
            del document["scenes"]["1"]
            (run / "run.json").write_text(json.dumps(document), encoding="utf-8")
        made[name] = root / name
        evaluate_bench(run, dataset.private, made[name], draws=10)
    return made


def test_paired_intervals_are_those_of_compare(folders, tmp_path):
    board = bench_table([*folders.values()], tmp_path / "t", draws=300)
    assert [row.agent for row in board.rows] == ["a", "b", "c"]
    settings = ComparisonSettings(draws=300, seed=0, allow_truth_prompts=False)
    document, _ = make_comparison([folders["a"], folders["b"]], tmp_path / "c", settings)
    (row,) = [r for r in document.pairs[0].rows if (r.metric, r.images) == ("S", "attempted")]
    first = board.standings.pairs[0]
    assert (first.first, first.second) == (0, 1)
    assert first.difference == pytest.approx(row.difference.value)
    assert first.interval.ends == pytest.approx(row.difference.interval.ends)
    assert [(p.first, p.second) for p in board.standings.pairs] == [(0, 1), (0, 2), (1, 2)]
    assert board.standings.pairs[2].difference == 0
    assert board.standings.pairs[2].interval.ends == (0, 0)


def test_equal_systems_share_a_rank(folders, tmp_path):
    board = bench_table([*folders.values()], tmp_path / "t", draws=300)
    ranks = board.standings.ranks
    assert [one.rank for one in ranks] == [1, 2, 2]
    assert ranks[1] == ranks[2]
    assert all(one.low <= one.rank <= one.high for one in ranks)
    # A draw of the families whose case is missing alone puts a last, behind both.
    worst = min(board.standings.pairs[0].interval.ends)
    assert ranks[0].high == (3 if worst < 0 else 1)


def test_what_trials_cost_is_their_scenes_word(folders, tmp_path):
    costs = bench_table([*folders.values()], tmp_path / "t", draws=50).standings.costs
    standard = (600 * 1.0 + 400 * 0.1 + 50 * 8.0) / 1e6
    a, b, c = costs
    assert (a.trials, a.told, a.usd) == (6, 5, pytest.approx(0.5))  # one has no scene
    assert a.standard_usd == pytest.approx(standard)
    assert (a.frontier, a.standard_frontier) == (False, False)
    assert (b.usd, b.told) == (None, 0)
    assert (b.standard_told, b.standard_frontier) == (6, True)
    assert (c.standard_usd, c.standard_told) == (None, 0)


@pytest.mark.parametrize(
    ("values", "prices", "frontier"),
    [
        ([0.9, 0.5, 0.4], [3.0, 2.0, 1.0], [True, True, True]),
        ([0.9, 0.5, 0.4], [1.0, 2.0, 1.0], [True, False, False]),
        ([0.9, 0.9], [1.0, 2.0], [True, False]),
        ([0.9, 0.9], [1.0, 1.0], [True, True]),
        ([0.9, 0.5], [1.0, 1.0], [True, False]),
        ([0.9, 0.5], [None, 1.0], [False, True]),
    ],
)
def test_the_frontier(values, prices, frontier):
    costs = [_cost([Usage(cost_usd=price)]) for price in prices]
    found = list(_on_frontier(costs, np.array(values)))
    assert [one.frontier for one in found] == frontier
    assert not any(one.standard_frontier for one in found)


def test_cached_tokens_are_a_part_of_the_prompt():
    assert STANDARD.cost_usd(10, 10, 0) == pytest.approx(1e-6)
    assert STANDARD.cost_usd(10, 0, 1) == pytest.approx(18e-6)


@pytest.mark.parametrize(
    "usage",
    [
        {**USAGE, "cost_usd": -5.0},
        {**USAGE, "cached_tokens": 1001},
        {"prompt_tokens": -1, "completion_tokens": 1},
    ],
)
def test_impossible_usage_of_a_scene_is_no_usage(usage, tmp_path):
    dataset = write_dataset(tmp_path / "dataset", families=1)
    run = write_run(tmp_path / "run", dataset, agent={"agent": "a", "model": "m", "usage": usage})
    evaluate_bench(run, dataset.private, tmp_path / "one", draws=10)
    (cost,) = bench_table([tmp_path / "one"], tmp_path / "t").standings.costs
    assert (cost.told, cost.standard_told, cost.frontier) == (0, 0, False)


def test_a_single_family_has_ranks_without_intervals(tmp_path):
    dataset = write_dataset(tmp_path / "dataset", families=1)
    run = write_run(tmp_path / "run", dataset, agent={"agent": "a", "model": "m"})
    evaluate_bench(run, dataset.private, tmp_path / "one", draws=10)
    standings = bench_table([tmp_path / "one"], tmp_path / "t").standings
    assert [(r.rank, r.low, r.high) for r in standings.ranks] == [(1, None, None)]
    assert standings.pairs == ()


def test_the_command_prints_and_writes_them(folders, tmp_path, capsys):
    words = ["bench", "table", *map(str, folders.values()), "-o", str(tmp_path / "t")]
    assert cli.run([*words, "--draws", "50"]) == 0
    out = capsys.readouterr().out
    lines = [line.split() for line in out.splitlines()]
    assert next(line for line in lines if "rank" in line)[:6] == [
        "agent",
        "model",
        "rank",
        "USD",
        "a",
        "trial",
    ]
    assert "0.5000 5/6" in out
    assert "0.0010 *" in out
    assert "+0.0 [0.0, 0.0]" in out
    assert "-0.0" not in out
    stored = json.loads((tmp_path / "t" / "leaderboard.json").read_text("utf-8"))["standings"]
    assert stored["metric"] == "S"
    for suffix in ("md", "tex", "csv"):
        assert "0.5000 5/6" in (tmp_path / "t" / f"standings.{suffix}").read_text("utf-8")
    assert cli.run([*words, "--draws", "50"]) == 0  # the same table again
    assert cli.run([*words, "--draws", "60"]) == 2
