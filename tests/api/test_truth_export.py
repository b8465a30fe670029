"""A scene's own answers as LVIS's and panopticapi's ground truth: perfect against themselves."""

from __future__ import annotations

import json
import shutil

import pytest
from checkout import CHECKOUT

from legoworld.api.evaluation import evaluate
from legoworld.api.exporting import export
from legoworld.api.readout import readout
from legoworld.errors import UsageError
from legoworld.evaluation.run import RunUnusableError

TASKS = ("lvis", "coco-panoptic", "voc-semantic")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A run of each task over one scene without Blender."""
    folder = tmp_path_factory.mktemp("truth")
    shutil.copytree(CHECKOUT / "examples" / "coffee", folder / "scenes" / "coffee")
    readout(folder / "scenes", folder / "runs", task=TASKS, source="glb", cache=False, workers=1)
    return folder / "runs"


def test_lvis_s_file_verifies_every_other_category_to_be_absent(runs, tmp_path):
    written = export(runs / "lvis", tmp_path / "lvis.json", format="lvis")
    truth = json.loads((tmp_path / "lvis.json").read_text())
    assert (written.images, written.annotations) == (1, len(truth["annotations"]))
    present = {one["category_id"] for one in truth["annotations"]}
    absent = set(truth["images"][0]["neg_category_ids"])
    assert present
    assert absent.isdisjoint(present)
    assert absent | present == {one["id"] for one in truth["categories"]}
    assert {one["frequency"] for one in truth["categories"]} == {"r", "c", "f"}
    done = evaluate(runs / "lvis", tmp_path / "e", truth=tmp_path / "lvis.json", draws=2)
    assert done.summary.metrics["AP"] == pytest.approx(1, abs=1e-12)  # lvis adds an epsilon


def test_panoptic_s_file_is_what_panopticapi_reads(runs, tmp_path):
    export(runs / "coco-panoptic", tmp_path / "truth", format="panoptic")
    file = tmp_path / "truth" / "panoptic.json"
    truth = json.loads(file.read_text())
    assert set(truth) == {"annotations", "categories", "images"}
    assert {one["isthing"] for one in truth["categories"]} == {0, 1}
    for one in truth["annotations"]:
        assert (tmp_path / "truth" / "panoptic" / one["file_name"]).is_file()
    done = evaluate(runs / "coco-panoptic", tmp_path / "e", truth=file, draws=2)
    assert done.summary.metrics["PQ"] == 1.0


def test_runs_of_other_tasks_and_lost_images_are_refused(runs, tmp_path):
    for form, task in (("lvis", "voc-semantic"), ("panoptic", "lvis")):
        with pytest.raises(UsageError, match=f"a run of {task} has no"):
            export(runs / task, tmp_path / "out", format=form)
    (tmp_path / "scenes" / "broken").mkdir(parents=True)
    (tmp_path / "scenes" / "broken" / "scene.glb").write_bytes(b"glTF")
    lost = tmp_path / "lost"
    readout(tmp_path / "scenes", lost, task="coco-panoptic", source="glb", cache=False, workers=1)
    with pytest.raises(RunUnusableError, match="without a result is no ground truth"):
        export(lost, tmp_path / "out", format="panoptic")
    assert not (tmp_path / "out").exists()
