"""Rows 37 to 42: what scoring an export means, beside what the official loaders do with it."""

from __future__ import annotations

import contextlib
import io
import json
import random
import shutil
from pathlib import Path
from typing import Any

import pytest
from evaluation.detection_runs import box_mask, random_predictions, random_truth, text_counts
from evaluation.official import direct_coco, evaluate
from pycocotools import mask
from pycocotools.coco import COCO

from legoworld import cli
from legoworld.evaluation.detection import lvis_package

SIZE_WH = (80, 60)
NAMES = ("collection_three_times", "particles", "ring")
TASKS = pytest.mark.parametrize("task", ["coco", "coco-masks", "lvis"])


@pytest.fixture(scope="module")
def exports(cases, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict[str, Any]]]:
    """What `legoworld readout` exports of three built scenes, by task."""
    folder = tmp_path_factory.mktemp("exports")
    images = []
    for number, name in enumerate(NAMES, start=1):
        place = folder / "scenes" / f"{number:012}"
        place.mkdir(parents=True)
        shutil.copyfile(cases.folder / name / "scene.blend", place / "scene.blend")
        width, height = SIZE_WH
        images.append(
            {"id": number, "file_name": f"{number:012}.jpg", "width": width, "height": height,
             "coco_url": f"http://images.example/{number:012}.jpg"}
        )  # fmt: skip
    track = folder / "track.json"
    track.write_text(json.dumps({"info": {}, "images": images, "categories": []}))
    found = {}
    for task in ("coco", "coco-masks", "lvis"):
        run = folder / task
        arguments = ["readout", "-q", folder / "scenes", "--task", task, "--track", track, "-o"]
        assert cli.run([str(a) for a in (*arguments, run, "--workers", 1)]) == 0
        found[task] = json.loads((run / "predictions.json").read_text())
    return found


def truth_of(task: str, predictions: list[dict[str, Any]], first_id: int = 1) -> dict[str, Any]:
    """The predictions as a truth that lists every image and category as fully checked."""
    ids = sorted({p["category_id"] for p in predictions})
    images = [
        {"id": i, "file_name": f"{i:012}.jpg", "width": SIZE_WH[0], "height": SIZE_WH[1]}
        for i in range(1, len(NAMES) + 1)
    ]
    if task == "lvis":
        for image in images:
            image |= {"neg_category_ids": ids, "not_exhaustive_category_ids": []}
    annotations = []
    for number, p in enumerate(predictions, start=first_id):
        annotation = {"id": number, "image_id": p["image_id"], "category_id": p["category_id"]}
        if task == "coco":
            x, y, w, h = p["bbox"]
            corners = [x, y, x + w, y, x + w, y + h, x, y + h]
            annotation |= {"bbox": p["bbox"], "area": w * h, "iscrowd": 0}
            annotation["segmentation"] = [corners]
        else:
            rle = p["segmentation"]
            annotation |= {"segmentation": rle, "area": float(mask.area(rle))}
            annotation["bbox"] = mask.toBbox(rle).tolist()
        annotations.append(annotation)
    categories = [{"id": i, "name": f"category {i}", "frequency": "f"} for i in ids]
    return {"images": images, "annotations": annotations, "categories": categories}


@pytest.mark.blender
@TASKS
def test_row_37_an_export_as_truth_and_as_detections_scores_one(task, exports, tmp_path):
    predictions = exports[task]
    assert len(predictions) >= 8
    summary = evaluate(tmp_path, task, truth_of(task, predictions), predictions)
    assert summary.metrics["AP"] == pytest.approx(1.0)
    assert summary.ties.worst == pytest.approx(1.0)


@pytest.mark.blender
def test_row_37_an_annotation_id_of_0_is_lost_by_the_official_evaluator_and_repaired_here(
    exports, tmp_path
):
    predictions = exports["coco"]
    from_zero = truth_of("coco", predictions, first_id=0)
    path = tmp_path / "zero.json"
    path.write_text(json.dumps(from_zero))
    assert direct_coco(path, predictions)[0][0] < 1.0
    summary = evaluate(tmp_path, "coco", from_zero, predictions)
    assert summary.metrics["AP"] == pytest.approx(1.0)
    assert any("annotation id 0" in warning for warning in summary.warnings)


@TASKS
def test_row_38_with_equal_scores_a_shuffled_file_scores_the_same(task, tmp_path):
    truth = random_truth(task, seed=38)
    predictions = [p | {"score": 1.0} for p in random_predictions(task, truth, seed=38)]
    first = evaluate(tmp_path / "a", task, truth, predictions)
    random.Random(38).shuffle(predictions)
    assert evaluate(tmp_path / "b", task, truth, predictions) == first
    assert first.ties.sd > 0  # the order does matter: it is what the canonical sort fixes


def test_row_39_the_cut_at_300_follows_the_canonical_order_and_is_counted(tmp_path):
    truth = random_truth("lvis", seed=39, images=1, per_image=5)
    assert truth["annotations"]
    category, other = sorted(c["id"] for c in truth["categories"])[::5]
    truth["annotations"] = truth["annotations"][:1]
    truth["annotations"][0]["category_id"] = other
    image = truth["images"][0]
    image |= {"neg_category_ids": [category], "not_exhaustive_category_ids": []}
    hit = {"image_id": image["id"], "category_id": other, "score": 1.0,
           "segmentation": truth["annotations"][0]["segmentation"]}  # fmt: skip
    empty = text_counts(box_mask([0, 0, 3, 3]))
    misses = [hit | {"category_id": category, "segmentation": empty} for _ in range(300)]
    for name, order in (("first", [hit, *misses]), ("last", [*misses, hit])):
        summary = evaluate(tmp_path / name, "lvis", truth, order)
        assert summary.counts.lost_to_cap == 1
        assert summary.metrics["AP"] == 0.0  # the higher category id is cut either way
    kept = evaluate(tmp_path / "kept", "lvis", truth, [hit, *misses[:299]])
    assert kept.counts.lost_to_cap == 0
    assert kept.metrics["AP"] == pytest.approx(1.0)


@pytest.mark.blender
def test_row_40_mask_exports_carry_no_bbox(exports):
    for prediction in (*exports["lvis"], *exports["coco-masks"]):
        assert set(prediction) == {"image_id", "category_id", "segmentation", "score"}
        assert isinstance(prediction["segmentation"]["counts"], str)


def test_row_40_a_bbox_in_lvis_results_does_not_become_the_masks_area(tmp_path):
    truth = random_truth("lvis", seed=40)
    predictions = random_predictions("lvis", truth, seed=40)
    boxed = [p | {"bbox": [1, 2, 3, 4]} for p in predictions]
    plain = evaluate(tmp_path / "plain", "lvis", truth, predictions)
    summary = evaluate(tmp_path / "boxed", "lvis", truth, boxed)
    assert summary.official == plain.official
    assert any(f"{len(boxed)} masks with a bbox" in w for w in summary.warnings)
    package = lvis_package.load()
    path = tmp_path / "direct.json"
    path.write_text(json.dumps(truth))
    with lvis_package.quiet(), contextlib.redirect_stdout(io.StringIO()):
        found = package.LVISResults(package.LVIS(str(path)), boxed)
    assert {a["area"] for a in found.dataset["annotations"]} == {12}  # w * h, not the masks'


@TASKS
def test_row_41_an_empty_result_list_is_a_result(task, tmp_path):
    truth = random_truth(task, seed=41)
    summary = evaluate(tmp_path, task, truth, [])
    assert summary.metrics["AP"] == 0.0
    assert summary.coverage.scored == summary.coverage.attempted


def test_row_41_the_official_loader_fails_on_an_empty_list(tmp_path: Path):
    path = tmp_path / "truth.json"
    path.write_text(json.dumps(random_truth("coco", seed=41)))
    with contextlib.redirect_stdout(io.StringIO()):
        true = COCO(str(path))
        with pytest.raises(IndexError):
            true.loadRes([])


def test_row_42_categories_nobody_checked_in_an_image_are_dropped_and_counted(tmp_path):
    truth = random_truth("lvis", seed=42)
    for image in truth["images"]:
        image["neg_category_ids"] = []
    present = {(a["image_id"], a["category_id"]) for a in truth["annotations"]}
    predictions = random_predictions("lvis", truth, seed=42)
    kept = [p for p in predictions if (p["image_id"], p["category_id"]) in present]
    whole = evaluate(tmp_path / "whole", "lvis", truth, predictions)
    assert whole.counts.unverified_dropped == len(predictions) - len(kept) > 0
    assert evaluate(tmp_path / "kept", "lvis", truth, kept).official == whole.official
