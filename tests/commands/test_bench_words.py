"""What the bench's commands print of a table and of judgements, in words and as JSON."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from legoworld import cli
from legoworld.commands.bench_table import _matrix
from legoworld.tables.table import Table, table

VERSION = {"schema_version": 1}


def show_table(title: str) -> Table:
    return table([title], [["cell"]], notes=(f"note of {title}",))


@pytest.mark.parametrize(("rows", "standings"), [(1, False), (2, True)])
@pytest.mark.parametrize("words", [(), ("-v",), ("--json",)])
def test_a_table_has_standings_where_there_are_two_rows(
    rows, standings, words, tmp_path, monkeypatch, capsys
):
    board = SimpleNamespace(rows=[0] * rows)
    asked: list[dict[str, Any]] = []
    for name, stand_in in {
        "legoworld.api.bench.bench_table": lambda *_, **given: asked.append(given) or board,
        "legoworld.comparison.leaderboard.wide_table": lambda _, every_group: show_table(
            f"every {every_group}"
        ),
        "legoworld.comparison.standings.standings_table": lambda _: show_table("standings"),
        "legoworld.records.base.as_json": lambda made: {"rows": len(made.rows)},
    }.items():
        monkeypatch.setattr(name, stand_in)
    (tmp_path / "e").mkdir()
    out = tmp_path / "table"
    command = ["bench", "table", str(tmp_path / "e"), "-o", str(out), "--draws", "7", *words]
    assert cli.run(command) == 0
    assert asked == [{"draws": 7, "seed": 0, "overwrite": False}]
    said = capsys.readouterr().out
    if words == ("--json",):
        assert json.loads(said) == VERSION | {
            "folder": str(out),
            "leaderboard": {"rows": rows},
        }
        return
    assert f"note of every {bool(words)}" in said
    assert ("note of standings" in said) is standings
    assert said.endswith(f"-> {out}\n")


def cell(share: float, n: int, ties: int = 0, **more: int) -> Any:
    known = {"both_bad": 0, "failed": 0, "score_ties": 0} | more
    return SimpleNamespace(share=share, n=n, ties=ties, **known)


AGREEMENT: Any = SimpleNamespace(
    matrix={"a": {"x": cell(0.5, 2, 1, failed=2), "y": cell(1.0, 3, score_ties=4)},
            "b": {"y": cell(0.25, 4, both_bad=3)}},
    self_mean=0.5, cross_mean=None, by_gap={"1-2": cell(0.875, 8)}, self_above_others=1, builders=2,
    order_swaps={"x": SimpleNamespace(share=None, swapped=0, first_share=0.5),
                 "y": SimpleNamespace(share=0.75, swapped=4, first_share=0.625)},
)  # fmt: skip


def test_judgements_are_a_matrix_with_their_counts():
    lines = _matrix(AGREEMENT).splitlines()
    assert [line.split() for line in [lines[0], *lines[2:-5]]] == [
        ["builder", "x", "y"], ["a", "50.0", "100.0"], ["b", "-", "25.0"],
    ]  # fmt: skip
    assert lines[-5:] == [
        "9 judgements: 1 ties, 3 both_bad, 2 failed; the score ties in 4",
        "own builds 50.00, others' -; own above the others' mean for 1 of 2 builders",
        "gap 1-2: 87.5 of 8",
        "x: the same choice in - of 0 swapped items; chose the first shown in 50.0%",
        "y: the same choice in 75.0% of 4 swapped items; chose the first shown in 62.5%",
    ]


@pytest.mark.parametrize("words", [(), ("--json",)])
def test_judgements_are_printed_by_their_aspect(words, tmp_path, monkeypatch, capsys):
    found = SimpleNamespace(aspects={"layout": AGREEMENT})
    monkeypatch.setattr("legoworld.api.bench.bench_judges", lambda *_, **__: found)
    monkeypatch.setattr("legoworld.records.base.as_json", lambda made: {"of": [*made.aspects]})
    (tmp_path / "j.jsonl").touch()
    assert cli.run(["bench", "judges", str(tmp_path / "j.jsonl"), *words]) == 0
    said = capsys.readouterr().out
    if words:
        assert json.loads(said) == VERSION | {"of": ["layout"]}
    else:
        assert said == f"layout\n{_matrix(AGREEMENT)}\n\n"


def test_a_seed_of_no_pairs_is_refused(tmp_path, capsys):
    (tmp_path / "j.jsonl").touch()
    assert cli.run(["bench", "judges", str(tmp_path / "j.jsonl"), "--seed", "3"]) == 2
    assert "--seed is for --trajectories" in capsys.readouterr().err
