"""The types of an evaluation's files say all they hold: read and written again, no byte changes."""

from __future__ import annotations

from pathlib import Path

import pytest
from comparison.evaluations import depth_scene_and_baseline, scene_and_baseline

from legoworld.evaluation.folder import EvaluationFolderError, read_summary
from legoworld.records.base import readable


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
