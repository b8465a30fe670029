"""Bench evaluations beside each other: paired by case, families drawn together; the table."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from comparison.evaluations import depth_scene_and_baseline
from evaluation.reconstruction.datasets import Submission, evaluate_bench, write_dataset, write_run

from legoworld import cli
from legoworld.comparison.compatibility import IncomparableError
from legoworld.comparison.leaderboard import (
    leaderboard,
    long_table,
    read_entries,
    wide_table,
    write_leaderboard,
)
from legoworld.comparison.make_comparison import make_comparison
from legoworld.comparison.verification import verify_comparison
from legoworld.errors import ConfigurationMismatchError, UsageError
from legoworld.evaluation.reconstruction.means import mean_and_sd
from legoworld.records.comparison import ComparisonSettings
from legoworld.tables.files import comma_separated, markdown

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


def test_a_side_without_appearance_has_no_number_of_it(made, tmp_path):
    _, dataset, folders = made
    run = write_run(tmp_path / "run", dataset, {3: Submission(no_render=True)},
                    agent={"agent": "agent c", "model": "m"})  # fmt: skip
    evaluate_bench(run, dataset.private, tmp_path / "c1", draws=10)
    document, _ = make_comparison([tmp_path / "c1", folders["b1"]], tmp_path / "c", SETTINGS)
    rows = {(row.metric, row.images): row for row in document.pairs[0].rows}
    for metric in ("A", "S"):
        for images in ("attempted", "paired"):
            row = rows[metric, images]
            assert (row.scene.value, row.scene.interval) == (None, None)
            assert row.scene.over == {"images": 6, "not valid": 0}
            assert row.baseline.interval is not None
            assert (row.difference.value, row.difference.interval) == (None, None)
    assert rows["R", "paired"].scene.value == 1.0
    # A table's order: by R where there is no S.
    board = leaderboard(read_entries([folders["b1"], tmp_path / "c1"]), draws=10)
    assert [row.agent for row in board.rows] == ["agent c", "agent b"]
    first = board.rows[0].groups[0].metrics
    assert [(first[m].mean, first[m].sd, first[m].interval) for m in "AS"] == [(None,) * 3] * 2
    assert next(line[-1] for line in long_table(board).rows if line[5] == "A") == "6"
    # Of three runs, one without A: no mean and no spread of the other alone.
    run = write_run(tmp_path / "run2", dataset, agent={"agent": "agent c", "model": "m"})
    evaluate_bench(run, dataset.private, tmp_path / "c2", draws=10)
    runs = [tmp_path / "c1", tmp_path / "c2", tmp_path / "c2"]
    (row,) = leaderboard(read_entries(runs), draws=10).rows
    found = row.groups[0].metrics
    assert found["A"].runs == (None, 1.0, 1.0)
    assert (found["A"].mean, found["A"].sd, found["A"].interval) == (None, None, None)
    assert (found["R"].runs, found["R"].mean, found["R"].sd) == ((1.0,) * 3, 1.0, 0.0)


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
                   options={"reference_sampling": "all"})  # fmt: skip
    with pytest.raises(IncomparableError, match="reference sampling raster and all"):
        make_comparison([folders["a1"], tmp_path / "all"], tmp_path / "c", SETTINGS)


def test_the_compare_command_prints_the_headline(made, tmp_path, capsys):
    _, _, folders = made
    words = ["compare", str(folders["a1"]), str(folders["b1"]), "-o", str(tmp_path / "c")]
    assert cli.run([*words, "--draws", "50"]) == 0
    out = capsys.readouterr().out
    assert "5 paired of 6 attempted" in out
    assert re.search(r"^not paired in bench, ", out, re.M)
    assert re.search(r"^\d+ notes? on interpretation, and all tables: -v$", out, re.M)
    assert cli.run([*words, "--draws", "50", "-v"]) == 0
    assert "not valid as 0" in capsys.readouterr().out
    assert cli.run([*words, "--draws", "50", "--fail-below", "S=0.9"]) == 3


def test_judges_beside_two_evaluations(made, tmp_path, capsys):
    _, _, folders = made
    rows = {
        name: {row.file_name: row for row in read_entries([folder])[0].reconstruction_rows}
        for name, folder in folders.items()
    }
    judged = tmp_path / "j.jsonl"
    with judged.open("w") as stream:
        for item, row in rows["a1"].items():
            higher = "a1" if row.R > rows["b1"][item].R else "b1"
            line = {"builder": "agent a", "judge": "j", "aspect": "reconstruction", "item": item,
                    "shown": ["b1", "a1"], "chosen": higher}  # fmt: skip
            stream.write(json.dumps(line) + "\n")
    words = ["bench", "judges", str(judged), str(folders["a1"]), str(folders["b1"])]
    assert cli.run(words) == 0
    assert (
        "6 judgements: 0 ties, 0 both_bad, 0 failed; the score ties in 0" in capsys.readouterr().out
    )
    assert cli.run([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["aspects"]["reconstruction"]["matrix"]["agent a"]["j"]["agreed"] == 6
    assert set(found["evidence_sha256"]) == {"a1", "b1"}


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

    def test_the_tables_to_the_last_cell(self, made):
        _, _, folders = made
        board = leaderboard(read_entries(list(folders.values())), draws=100)
        first, second = board.rows
        wide = wide_table(board)
        assert wide.header == (
            "agent", "model", "runs", "group", "cases", "V", "R", "A", "S", "R valid", "A valid",
            "S valid",
        )  # fmt: skip
        metrics = first.groups[0].metrics
        cells = [f"{100 * metrics[m].mean:.1f} ({100 * metrics[m].sd:.1f})"
                 for m in ("V", "R", "A", "S", "R_valid", "A_valid", "S_valid")]  # fmt: skip
        assert wide.rows[0] == ("agent a", "m", 2, "all", 6, *cells)
        alone = second.groups[0].metrics
        other = wide.rows[len(first.groups)]
        assert [*map(str, other[:6])] == ["agent b", "m", "1", "all", "6", "100.0"]
        assert {row[3] for row in wide.rows} == {
            "all", "split test", "environment indoor", "environment outdoor", "tier easy",
            "tier hard",
        }  # fmt: skip
        ends = [
            "S [{:.1f}, {:.1f}] (95 %, 100 draws of families).".format(
                *(100 * end for end in of["S"].interval.ends)
            )
            for of in (metrics, alone)
        ]
        assert wide.notes[2:] == (
            "agent b m: a single run, so no standard deviation.",
            f"agent a m: {ends[0]}",
            f"agent b m: {ends[1]}",
        )
        lines = csv.reader(comma_separated(long_table(board)).splitlines())
        by_name = {(row[0], row[3], row[5]): row for row in map(tuple, lines)}
        low, high = metrics["S"].interval.ends
        assert by_name["agent a", "all", "S"][6:] == (
            "attempted", repr(metrics["S"].mean), repr(metrics["S"].sd), repr(low), repr(high),
            "6 6",
        )  # fmt: skip
        assert by_name["agent a", "tier", "S_valid"][9:11] == ("", "")
        assert by_name["agent b", "all", "V"][7:9] == ("1.0", "")
        assert low < metrics["S"].mean < high

    def test_a_folder_with_something_else_is_left_alone(self, made, tmp_path):
        _, _, folders = made
        board = leaderboard(read_entries([folders["b1"]]), draws=10)
        for name in "gfedcba":
            (tmp_path / name).write_text("")
        with pytest.raises(ConfigurationMismatchError) as caught:
            write_leaderboard(tmp_path, board, overwrite=True)
        assert (caught.value.found, caught.value.next_step) == (
            "a, b, c, d, e",
            "choose another -o",
        )
        write_leaderboard(tmp_path / "new", board, overwrite=False)
        other = leaderboard(read_entries([folders["b1"]]), draws=11)
        with pytest.raises(ConfigurationMismatchError) as caught:
            write_leaderboard(tmp_path / "new", other, overwrite=False)
        assert caught.value.found == "the table of other evaluations"
        assert caught.value.next_step == "choose another -o, or pass --overwrite"

    def test_several_makers_of_one_run_are_all_named(self, made, tmp_path):
        _, dataset, _ = made
        run = write_run(tmp_path / "run", dataset, agent={"agent": "x", "model": None})
        document = json.loads((run / "run.json").read_text())
        document["scenes"]["2"]["provenance"] = {"agent": "a"}
        document["scenes"]["3"]["provenance"] = "unreadable"
        (run / "run.json").write_text(json.dumps(document))
        evaluate_bench(run, dataset.private, tmp_path / "eval", draws=10)
        (row,) = leaderboard(read_entries([tmp_path / "eval"]), draws=10).rows
        assert (row.agent, row.model, row.evaluations) == ("a + x", "not recorded", ("eval",))

    def test_the_command_writes_the_same_again(self, made, tmp_path, capsys):
        _, _, folders = made
        words = ["bench", "table", *map(str, folders.values()), "-o", str(tmp_path / "t")]
        assert cli.run([*words, "--draws", "100"]) == 0
        out = capsys.readouterr().out
        assert "agent a" in out
        assert "75.0 (11.8)" in out
        before = {p.name: p.read_bytes() for p in (tmp_path / "t").iterdir()}
        tables = {f"{t}.{x}" for t in ("leaderboard", "standings") for x in ("md", "tex", "csv")}
        assert set(before) == {"leaderboard.json", *tables}
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


def test_a_run_that_lacks_a_number_is_not_in_its_spread():
    assert mean_and_sd([0.5]) == (0.5, None)
    assert mean_and_sd([0.25, 0.75]) == (0.5, pytest.approx(np.std([0.25, 0.75], ddof=1)))
