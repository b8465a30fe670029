"""Bench evaluations beside each other: paired by case, families drawn together; the table."""

from __future__ import annotations

import numpy as np
import pytest
from comparison.evaluations import depth_scene_and_baseline
from evaluation.reconstruction.datasets import Submission, write_dataset, write_run

from legoworld import cli
from legoworld.comparison.compatibility import IncomparableError
from legoworld.comparison.formats import markdown
from legoworld.comparison.leaderboard import leaderboard, read_entries, wide_table
from legoworld.comparison.making import make_comparison
from legoworld.comparison.verification import verify_comparison
from legoworld.errors import UsageError
from legoworld.evaluation.reconstruction.choices import Choices
from legoworld.evaluation.reconstruction.evaluate import evaluate_bench
from legoworld.records.evidence import ComparisonSettings

SETTINGS = ComparisonSettings(draws=200, seed=0, allow_truth_prompts=False)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two agents; a2 repeats a1 with one more case that is not valid."""
    root = tmp_path_factory.mktemp("bench")
    dataset = write_dataset(root / "dataset", families=3)
    far = {i: Submission(depth_z_m=c.depth_z_m * np.float32(1.045 + 0.01 * i))
           for i, c in dataset.cases.items()}  # fmt: skip
    runs = {
        "a1": ("agent a", {1: Submission(status="missing")}),
        "a2": ("agent a", {1: Submission(status="missing"), 2: Submission(status="failed")}),
        "b1": ("agent b", far),
    }
    folders = {}
    for name, (agent, submissions) in runs.items():
        run = write_run(root / f"run-{name}", dataset, submissions,
                        agent={"agent": agent, "model": "m"})  # fmt: skip
        folders[name] = root / name
        evaluate_bench(run, dataset.private, folders[name], draws=200)
    return root, dataset, folders


def test_a_comparison_is_paired_by_case_and_draws_families(made, tmp_path):
    _, _, folders = made
    document, _ = make_comparison([folders["a1"], folders["b1"]], tmp_path / "c", SETTINGS)
    assert document.bootstrap.unit == "family"
    pair = document.pairs[0]
    assert (pair.coverage.attempted, pair.coverage.paired) == (6, 5)
    assert pair.dropped[0].reasons == (f"{pair.scene}: missing",)
    rows = {(row.metric, row.images): row for row in pair.rows}
    assert rows["V", "attempted"].scene.value == pytest.approx(5 / 6)
    assert rows["R", "paired"].scene.value == 1.0
    assert ("V", "paired") not in rows
    difference = rows["S", "attempted"].difference
    assert difference.value == pytest.approx(
        rows["S", "attempted"].scene.value - rows["S", "attempted"].baseline.value
    )
    assert difference.interval.unit == "family"
    assert rows["S", "attempted"].scene.over == {"images": 6, "not valid": 1}
    assert {m for m, _ in rows if rows[m, "attempted"].level == 1} == {"V", "R", "A", "S"}
    assert {row.level for row in pair.rows} == {1, 3}
    assert {(row.policy, row.better) for row in pair.rows} == {("-", "higher")}
    assert {check.status for check in verify_comparison(tmp_path / "c", None)} == {"ok"}


def test_an_evaluation_beside_itself_differs_by_nothing(made, tmp_path):
    _, _, folders = made
    document, _ = make_comparison([folders["b1"], folders["b1"]], tmp_path / "c", SETTINGS)
    for row in document.pairs[0].rows:
        assert row.difference.value == 0
        assert row.difference.interval.ends == (0, 0)


def test_other_datasets_and_samplings_are_not_compared(made, tmp_path):
    root, dataset, folders = made
    other = write_dataset(tmp_path / "other", families=3, seed=5)
    evaluate_bench(write_run(tmp_path / "run", other), other.private, tmp_path / "o", draws=10)
    with pytest.raises(IncomparableError, match="truth"):
        make_comparison([folders["a1"], tmp_path / "o"], tmp_path / "c", SETTINGS)
    evaluate_bench(root / "run-a1", dataset.private, tmp_path / "all", draws=10,
                   choices=Choices(sampling="all"))  # fmt: skip
    with pytest.raises(IncomparableError, match="reference sampling raster and all"):
        make_comparison([folders["a1"], tmp_path / "all"], tmp_path / "c", SETTINGS)


def test_the_compare_command_prints_the_headline(made, tmp_path, capsys):
    _, _, folders = made
    words = ["compare", str(folders["a1"]), str(folders["b1"]), "-o", str(tmp_path / "c")]
    assert cli.run([*words, "--draws", "50"]) == 0
    out = capsys.readouterr().out
    assert "5 paired of 6 attempted" in out
    assert cli.run([*words, "--draws", "50", "-v"]) == 0
    assert "not valid as 0" in capsys.readouterr().out
    assert cli.run([*words, "--draws", "50", "--fail-below", "S=0.9"]) == 3


def test_an_export_of_a_bench_run_is_refused_in_one_line(made, tmp_path, capsys):
    root, _, _ = made
    assert cli.run(["export", str(root / "run-a1"), "-o", str(tmp_path / "coco.json")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "bench" in said


class TestTable:
    """`legoworld bench table`."""

    def test_repeats_are_one_row_with_their_spread(self, made):
        _, _, folders = made
        board = leaderboard(read_entries(list(folders.values())), draws=100)
        first, second = board.rows
        assert [(r.agent, r.model, len(r.evaluations)) for r in board.rows] == [
            ("agent a", "m", 2), ("agent b", "m", 1),
        ]  # fmt: skip
        every = first.groups[0].metrics
        assert every["V"].runs == (pytest.approx(5 / 6), pytest.approx(4 / 6))
        assert every["V"].sd == pytest.approx(np.std([5 / 6, 4 / 6], ddof=1))
        assert every["S"].n == (6, 6)
        assert every["S_valid"].n == (5, 4)
        assert every["S_valid"].mean == 1.0
        assert every["S"].interval.unit == "family"
        assert second.groups[0].metrics["S"].sd is None
        kinds = {(g.kind, g.name) for g in first.groups}
        assert {("tier", "easy"), ("tier", "hard"), ("environment", "indoor"), ("all", "all"),
                ("split", "test")} <= kinds  # fmt: skip

    def test_the_command_writes_the_same_again(self, made, tmp_path, capsys):
        _, _, folders = made
        words = ["bench", "table", *map(str, folders.values()), "-o", str(tmp_path / "t")]
        assert cli.run([*words, "--draws", "100"]) == 0
        out = capsys.readouterr().out
        assert "agent a" in out
        assert "75.0 (11.8)" in out
        before = {p.name: p.read_bytes() for p in (tmp_path / "t").iterdir()}
        assert set(before) == {f"leaderboard.{x}" for x in ("json", "md", "tex", "csv")}
        assert cli.run([*words, "--draws", "100"]) == 0
        assert {p.name: p.read_bytes() for p in (tmp_path / "t").iterdir()} == before
        lines = (tmp_path / "t" / "leaderboard.csv").read_text().splitlines()
        assert lines[0].startswith("agent,model,runs,group_kind,group,metric,over,mean,sd")
        assert any(line.startswith("agent a,m,2,tier,easy,S_valid,valid,1.0,0.0") for line in lines)
        assert cli.run([*words, "--draws", "50"]) == 2
        assert cli.run([*words, "--draws", "50", "--overwrite"]) == 0

    def test_a_single_family_has_no_interval_and_no_note_of_one(self, tmp_path):
        dataset = write_dataset(tmp_path / "dataset", families=1, tiers=("easy", None))
        evaluate_bench(write_run(tmp_path / "run", dataset), dataset.private, tmp_path / "eval",
                       draws=10)  # fmt: skip
        board = leaderboard(read_entries([tmp_path / "eval"]), draws=10)
        groups = board.rows[0].groups
        assert groups[0].metrics["S"].interval is None
        assert "of families" not in markdown(wide_table(board))
        # "unstated" is a group beside another one, and none where it is all there is.
        kinds = {(g.kind, g.name) for g in groups}
        assert {("tier", "easy"), ("tier", "unstated")} <= kinds
        assert ("theme", "unstated") not in kinds

    def test_another_task_is_refused(self, tmp_path):
        scene, _ = depth_scene_and_baseline(tmp_path)
        with pytest.raises(UsageError, match="no evaluation of a bench"):
            read_entries([scene])
