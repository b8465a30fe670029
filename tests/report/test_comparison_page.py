"""A comparison's page: its own numbers, its evaluations' photos, and nothing mixed up."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from report.pages import Tables, document_of, evaluate, page_of

from legoworld import cli
from legoworld.records.comparison import Measured
from legoworld.report.sources import ReportInputError, read_sources
from legoworld.report.tables import comparison_tables


@pytest.fixture
def comparison(tmp_path: Path) -> Path:
    scene = evaluate(tmp_path, "coco", statuses={10: "failed"})
    other = evaluate(tmp_path, "coco", levels=None, kind="baseline", baseline="random")
    folder = tmp_path / "comparison"
    arguments = ["compare", str(scene), str(other), "-o", str(folder), "--draws", "20"]
    assert cli.run(arguments) == 0
    return folder


def test_every_difference_stands_with_both_sides_and_denominators(
    comparison: Path, tmp_path: Path
) -> None:
    document = json.loads((comparison / "comparison.json").read_text())
    (pair,) = document["pairs"]
    page = page_of(tmp_path / "r.html", comparison)
    shown = [r for r in Tables(page).rows if len(r) == 6 and r[1] in ("attempted", "paired")]
    assert len(shown) == len(pair["rows"]) > 20
    cells = {(r[1], r[2].split("higher")[0].split("lower")[0], r[0]): r[3:] for r in shown}
    for row in pair["rows"]:
        name = row["metric"].removeprefix(f"{row['policy']}.")
        difference, *sides = cells[row["images"], row["policy"].replace("_", " "), name]
        value = row["difference"]["value"]
        assert difference.startswith("-" if value is None else f"{value:+.4f}")
        for text, side in zip(sides, (row["scene"], row["baseline"]), strict=True):
            assert text.startswith("-" if side["value"] is None else f"{side['value']:.4f}")
            assert f"{side['over']['images']} images" in text
            if side["interval"] and side["interval"]["low"] is not None:
                low, high = side["interval"]["low"], side["interval"]["high"]
                assert f"[{low:.4f}, {high:.4f}]" in text
    text = page.read_text()
    assert f"<b>{pair['coverage']['paired']} paired</b>" in text
    for sentence in document["notes"]:
        assert sentence in text
    assert "scene: failed" in text
    assert "legoworld compare eval-coco-scene eval-coco-random --draws 20 --seed 0" in text


def test_it_brings_its_evaluations_scene_first(comparison: Path, tmp_path: Path) -> None:
    document = document_of(comparison)
    (section,) = document.sections
    assert [side.label for side in section.sides] == ["scene", "random"]
    assert len(document.views) == 12
    again = document_of(comparison, tmp_path / "eval-coco-scene")
    assert len(again.views) == 12


def test_without_its_evaluations_the_tables_stand_alone(comparison: Path, tmp_path: Path) -> None:
    for name in ("eval-coco-scene", "eval-coco-random"):
        shutil.rmtree(tmp_path / name)
    page = page_of(tmp_path / "r.html", comparison)
    assert "are not where it found them" in page.read_text()
    assert document_of(comparison).views == []


def test_an_evaluation_made_anew_is_not_taken_for_the_compared_one(
    comparison: Path, tmp_path: Path
) -> None:
    evaluate(tmp_path, "coco", statuses={10: "failed", 13: "failed"})
    with pytest.raises(ReportInputError, match="is not what comparison was computed from"):
        document_of(comparison)


def make_measured(**changed: Any) -> Measured:
    fields = {"value": 0.5, "interval": None, "over": {"objects": 4, "images": 2, "at_once": 1}}
    return Measured(**{**fields, **changed})


def test_a_deviation_stands_where_no_interval_does(comparison: Path) -> None:
    (document,) = [s.comparison for s in read_sources([comparison])]
    assert document is not None
    (pair,) = document.pairs
    ends = next(r.scene.interval for r in pair.rows if r.scene.ends)
    cells = {
        "": make_measured(),
        "sd 0.1250": make_measured(sd=0.125),
        f"[{ends.low:.4f}, {ends.high:.4f}]": make_measured(sd=0.125, interval=ends),
    }
    for spread, cell in cells.items():
        row = replace(pair.rows[0], scene=cell, baseline=replace(cell, constant=0.25))
        shown = comparison_tables(replace(document, pairs=(replace(pair, rows=(row,)),)))
        scene, baseline = shown[0].tables[0].rows[0][4:]
        assert (str(scene), scene.interval_text) == ("0.5000", spread)
        assert scene.below == "2 images, 1 at once, 4 objects"
        assert baseline.below == "2 images, 1 at once, 4 objects; a constant: 0.2500"
