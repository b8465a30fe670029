"""The two val2017 images that panopticapi ships with their ground truth."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from evaluation.panoptic.official_rule import ids_of, quality
from evaluation.panoptic.panoptic_files import scored, write_ids

pytestmark = [pytest.mark.real_data]


@pytest.fixture
def truth(real_data: Path, tmp_path: Path) -> Path:
    """The JSON file with its folder of PNGs beside it, where answers can be written, too."""
    shutil.copyfile(real_data / "panoptic/panoptic_examples.json", tmp_path / "truth.json")
    shutil.copytree(real_data / "panoptic/panoptic_examples", tmp_path / "truth")
    return tmp_path / "truth.json"


def test_truth_as_an_answer_scores_one_but_for_crowds(truth, tmp_path):
    """A crowd that is answered as segments lies on its crowd, and is dropped."""
    found = scored(tmp_path, truth, truth)
    assert set(found["metrics"].values()) == {1.0}
    assert found["dataset_version"] == "2017"
    assert sum(c["counts"][0] for c in found["categories"]) == 47


def test_shifted_answers_score_what_the_official_rule_gives(truth, tmp_path):
    document = json.loads(truth.read_text())
    for entry in document["annotations"]:
        ids = np.roll(ids_of(truth.with_suffix("") / entry["file_name"]), (3, 5), (0, 1))
        dropped = entry["segments_info"][::4]
        ids[np.isin(ids, [segment["id"] for segment in dropped])] = 0
        seen = set(np.unique(ids).tolist())
        entry["segments_info"] = [s for s in entry["segments_info"] if s["id"] in seen]
        write_ids(tmp_path / "theirs" / entry["file_name"], ids)
    (tmp_path / "theirs.json").write_text(json.dumps(document))
    found = scored(tmp_path, truth, tmp_path / "theirs.json")
    assert found["metrics"] == quality(truth, tmp_path / "theirs.json")
    assert 0.3 < found["metrics"]["PQ"] < 0.9
