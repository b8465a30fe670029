"""The types of an evaluation's files say all they hold: read and written again, no byte changes."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from comparison.evaluations import compare, depth_scene_and_baseline, scene_and_baseline

from legoworld.comparison.folder import read_document
from legoworld.records.base import as_json, canonical, decode, readable
from legoworld.records.coco_file import ShownPrediction, TruthView
from legoworld.records.comparison import ComparisonEvidence
from legoworld.records.depth import DepthView
from legoworld.records.folders.read_evaluation import (
    EvaluationFolderError,
    read_category_rows,
    read_evaluation_evidence,
    read_image_rows,
    read_summary,
)
from legoworld.records.formats import schema_text


@pytest.fixture(scope="module", params=["coco", "coco-masks", "lvis", "eth3d"])
def evaluations(request, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A scene's evaluation and a baseline's."""
    folder = tmp_path_factory.mktemp(request.param)
    if request.param == "eth3d":
        return depth_scene_and_baseline(folder)
    return scene_and_baseline(folder, request.param)


def test_summaries(evaluations: tuple[Path, Path]) -> None:
    for folder in evaluations:
        assert readable(read_summary(folder)) == (folder / "summary.json").read_text()


def test_rows(evaluations: tuple[Path, Path]) -> None:
    for folder in evaluations:
        rows = read_image_rows(folder, read_summary(folder))
        text = "".join(canonical(row) + "\n" for row in rows)
        assert text == (folder / "per_image.jsonl").read_text()
        categories = folder / "per_category.jsonl"
        if categories.is_file():
            lines = (canonical(row) + "\n" for row in read_category_rows(folder))
            assert "".join(lines) == categories.read_text()


def test_evidence(evaluations: tuple[Path, Path]) -> None:
    for folder in evaluations:
        evidence = read_evaluation_evidence(folder)
        assert readable(evidence) == (folder / "evidence.json").read_text()


def test_comparisons_and_their_evidence(evaluations: tuple[Path, Path], tmp_path: Path) -> None:
    compare(evaluations, tmp_path / "out", draws=5)
    text = (tmp_path / "out" / "comparison.json").read_text()
    assert readable(read_document(tmp_path / "out")) == text
    data = (tmp_path / "out" / "evidence.json").read_bytes()
    assert readable(decode(ComparisonEvidence, data)).encode() == data


def test_views_of_boxes_and_masks(evaluations: tuple[Path, Path]) -> None:
    """All that a reader takes of them is there as it was written."""
    for folder in evaluations:
        path = folder / "view" / "predictions.json"
        if not path.is_file():
            continue
        shown = decode(list[ShownPrediction], path.read_bytes())
        for found, written in zip(as_json(shown), json.loads(path.read_text()), strict=True):
            assert json.loads(json.dumps(found)).items() <= written.items()
            assert written.keys() - found.keys() == {"pair_annotation", "pair_iou"}
        path = folder / "view" / "truth.json"
        truth, written = decode(TruthView, path.read_bytes()), json.loads(path.read_text())
        for name in ("images", "categories", "annotations"):
            for one, entry in zip(getattr(truth, name), written[name], strict=True):
                assert json.loads(canonical(one)).items() <= entry.items()


def test_views_of_depth(tmp_path: Path) -> None:
    folder, _ = depth_scene_and_baseline(tmp_path)
    views = [p for p in (folder / "view").iterdir() if p.name != "run.json"]
    assert len(views) == 3
    for path in views:
        assert canonical(decode(DepthView, path.read_bytes())) + "\n" == path.read_text()


def test_a_scored_row_has_its_numbers(tmp_path: Path) -> None:
    folder, _ = depth_scene_and_baseline(tmp_path)
    path = folder / "per_image.jsonl"
    path.write_text(path.read_text().replace('"hole_share"', '"hole_scare"', 1))
    with pytest.raises(EvaluationFolderError, match=r"image 1: object missing .* hole_share"):
        read_image_rows(folder, read_summary(folder))


@pytest.mark.parametrize(
    ("before", "after", "found"),
    [
        ('"attempted": 12', '"attempted": "12"', "expected int, got str at $.coverage.attempted"),
        ('"task": "coco"', '"tusk": "coco"', "missing required field task"),
        ('"AP": ', '"AP": -', "not JSON"),
    ],
)
def test_a_damaged_summary_is_said_with_its_place(
    tmp_path: Path, before: str, after: str, found: str
) -> None:
    folder, _ = scene_and_baseline(tmp_path, "coco")
    text = (folder / "summary.json").read_text()
    (folder / "summary.json").write_text(text.replace(before, after).replace("--", "-,-"))
    with pytest.raises(EvaluationFolderError) as error:
        read_summary(folder)
    assert found in str(error.value)
    assert "eval/summary.json cannot be read" in str(error.value)


def test_the_schemas_are_true_of_what_is_written(
    evaluations: tuple[Path, Path], tmp_path: Path
) -> None:
    kind = "depth" if (evaluations[0] / "view" / "1.json").is_file() else "detection"
    compare(evaluations, tmp_path / "out", draws=5)
    valid(tmp_path / "out" / "comparison.json", "comparison")
    for folder in evaluations:
        valid(folder / "summary.json", f"evaluation-summary-{kind}")
        valid(folder / "evidence.json", f"evaluation-evidence-{kind}")
        for line in (folder / "per_image.jsonl").read_text().splitlines():
            scored = kind == "depth" and "metrics" in json.loads(line)
            name = f"evaluation-per-image-{kind}{'-scored' * scored}"
            jsonschema.validate(json.loads(line), schema(name))


def valid(path: Path, name: str) -> None:
    jsonschema.validate(json.loads(path.read_text()), schema(name))


def schema(name: str) -> dict[str, object]:
    return json.loads(schema_text(name))
