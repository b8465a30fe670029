"""Three systems on one page: one against each other as `compare` says it, and photo by photo."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from evaluation.detection_runs import random_predictions, random_truth
from report.pages import document_of, evaluate

from legoworld.api.comparison import compare
from legoworld.comparison import ranks
from legoworld.comparison.ranks import rank_systems
from legoworld.records.base import as_json
from legoworld.records.comparison import ComparisonSettings
from legoworld.report.sources import read_sources
from legoworld.tables.table import Number, Text

NAMES = ("scene", "near", "far")


@pytest.fixture(scope="module")
def sides(tmp_path_factory):
    """The scene's run with a failed photo, and two baselines of one truth."""
    folder = tmp_path_factory.mktemp("systems")
    truth = random_truth("coco", seed=3, images=8)
    made = []
    for k, name in enumerate(NAMES):
        predictions = random_predictions("coco", truth, seed=3 + k, levels=None)
        more = {} if k == 0 else {"kind": "baseline", "baseline": name}
        failed = {10: "failed"} if k == 0 else None
        made.append(
            evaluate(folder, "coco", truth=truth, predictions=predictions, statuses=failed, **more)
        )
    return made


@pytest.fixture(scope="module")
def section(sides):
    (made,) = document_of(*sides).sections
    return made


def table_titled(tables, title):
    return next(one for one in tables if one.title == title)


def test_differences_are_those_of_compare(sides, section, tmp_path):
    shown = table_titled(section.overview, "Systems")
    names = [row[1] for row in shown.rows]
    for i, first in enumerate(names):
        others = [k for k in range(3) if k != i]
        order = [sides[i], *(sides[k] for k in others)]
        document = compare(order, tmp_path / first).document
        for k, pair in zip(others, as_json(document)["pairs"], strict=True):
            row = next(
                r for r in pair["rows"] if r["metric"] == "AP" and r["images"] == "attempted"
            )
            cell, interval = shown.rows[i][4 + k], row["difference"]["interval"]
            assert cell.value == pytest.approx(row["difference"]["value"], abs=1e-15)
            assert cell.ends == (interval["low"], interval["high"])
            assert shown.rows[i][2] == Number(value=row["scene"]["value"])
        assert shown.rows[i][4 + i] == ""


def test_every_photo_by_system(section):
    shown = table_titled(section.numbers, "Every photo by system")
    assert [column.name for column in shown.columns] == ["photo", *NAMES]
    by_name = {row.file_name: row for row in section.images}
    assert len(shown.rows) == len(by_name) == 8
    spreads = []
    for name, *cells in shown.rows:
        row = by_name[name.text]
        assert name == Text(text=row.file_name, link=f"#/{section.key}/{row.id}")
        for cell, one in zip(cells, row.cells, strict=True):
            want = Number(value=one.quality, digits=3) if one.status == "ok" else one.status
            assert cell == want
        values = [one.quality for one in row.cells if one.quality is not None]
        whole = all(one.status == "ok" for one in row.cells)
        spreads.append((whole, min(values) - max(values)))
    assert spreads == sorted(spreads)
    assert not spreads[0][0]
    assert ["failed" in row for row in shown.rows].count(True) == 1


def test_two_systems_have_their_comparison_instead(sides):
    (section,) = document_of(*sides[:2]).sections
    titles = [one.title for one in (*section.overview, *section.numbers)]
    assert {"Systems", "Every photo by system"}.isdisjoint(titles)
    assert len(read_sources(sides)[0].sides) == 3


def test_ranks_with_ties_and_what_is_undefined():
    values = np.array([0.5, 0.7, 0.5, np.nan])
    assert [rank.rank for rank in rank_systems(values, None)] == [2, 1, 2, 4]
    draws = np.array([[0.5] * 40, [0.7] * 38 + [0.4] * 2, [0.5] * 40, [np.nan] * 40])
    drawn = list(rank_systems(values, draws))
    assert [(rank.low, rank.high) for rank in drawn] == [(1, 2), (1, 3), (1, 2), (4, 4)]


def test_lower_is_better_for_an_error(sides, monkeypatch):
    """The sign of the metric alone decides the order."""
    settings = ComparisonSettings(draws=20, seed=0, allow_truth_prompts=True)
    read = read_sources(sides)[0].sides
    best = ranks.rank_sides(read, "AP", settings)
    family = ranks.load_comparison_family("coco")
    flipped = [
        dataclasses.replace(metric, better="lower") if metric.id == "AP" else metric
        for metric in family.metrics("coco")
    ]
    changed = dataclasses.replace(family, metrics=lambda _task: flipped)
    monkeypatch.setattr(ranks, "load_comparison_family", lambda _task: changed)
    worst = ranks.rank_sides(read, "AP", settings)
    assert [4 - rank.rank for rank in worst.ranks] == [rank.rank for rank in best.ranks]
