"""summary.json and the rows against counts made here from the truth and the predictions."""

from __future__ import annotations

import copy
import json
from collections import Counter

import pytest
from evaluation.detection_runs import (
    evaluate_detections,
    random_predictions,
    random_truth,
    read_rows,
    write_run,
    write_truth,
)
from evaluation.official import evaluate

from legoworld.errors import ConfigurationMismatchError, LegoWorldError
from legoworld.evaluation.detection.inputs.box_formats import BoxFormatError, check_box_format
from legoworld.evaluation.detection.text import detection_metrics, notes
from legoworld.evaluation.metrics import metric_tables
from legoworld.records.folders.evaluation_folder import EVIDENCE, prepare_folder

TASKS = ["coco", "coco-masks", "lvis"]


def scored(folder, task, truth, predictions, statuses=None):
    """summary.json of a run, some of whose images were not read."""
    read = [p for p in predictions if p["image_id"] not in (statuses or {})]
    evaluate(folder, task, truth, read, statuses=statuses, draws=3)
    return json.loads((folder / "eval" / "summary.json").read_text())


@pytest.fixture(params=TASKS)
def case(request):
    """A task, a truth with images that have none, and predictions of some images."""
    truth = random_truth(request.param, seed=11, images=14, per_image=3)
    predictions = random_predictions(request.param, truth, seed=12, per_image=4)
    silent = [i["id"] for i in truth["images"]][1::4]
    return request.param, truth, [p for p in predictions if p["image_id"] not in silent]


def test_coverage_is_what_can_be_counted(case, tmp_path):
    task, truth, predictions = case
    ids = [i["id"] for i in truth["images"]]
    unread = {ids[2]: "missing", ids[5]: "timeout", ids[8]: "missing"}
    coverage = scored(tmp_path, task, truth, predictions, unread)["coverage"]
    with_truth = {a["image_id"] for a in truth["annotations"] if not a.get("iscrowd")}
    read = set(ids) - set(unread)
    assert 0 < len(with_truth & read) < len(with_truth) < len(ids)
    assert coverage == {
        "attempted": len(ids),
        "scored": len(read),
        "with_truth": len(with_truth),
        "scored_with_truth": len(with_truth & read),
        "scored_without_predictions": len(read - {p["image_id"] for p in predictions}),
        "by_status": {"missing": 2, "ok": len(read), "timeout": 1},
    }


def test_counts_are_what_can_be_counted(case, tmp_path):
    task, truth, predictions = case
    counts = scored(tmp_path, task, truth, predictions)["counts"]
    plain = [a for a in truth["annotations"] if not a.get("iscrowd")]
    of_category = Counter(a["category_id"] for a in plain)
    assert counts["categories"] == len(truth["categories"])
    assert counts["categories_with_truth"] == len(of_category)
    assert counts["truth_instances"] == len(plain)
    assert counts["truth_ignored"] == len(truth["annotations"]) - len(plain)
    assert counts["empty_masks_dropped"] == counts["lost_to_cap"] == 0
    limits = {
        "all": (0, 1e10),
        "small": (0, 32**2),
        "medium": (32**2, 96**2),
        "large": (96**2, 1e10),
    }
    for area, (least, most) in limits.items():
        mine = [a for a in plain if least <= a["area"] < most]
        assert counts["areas"][area] == {
            "categories_with_truth": len({a["category_id"] for a in mine}),
            "truth_instances": len(mine),
        }
    letters = {c["id"]: c["frequency"] for c in truth["categories"]}
    if task != "lvis":
        assert "frequency_groups" not in counts
        return
    assert counts["frequency_groups"] == {
        letter: {
            "categories": sum(one == letter for one in letters.values()),
            "categories_with_truth": sum(letters[k] == letter for k in of_category),
            "truth_instances": sum(letters[a["category_id"]] == letter for a in plain),
        }
        for letter in "rcf"
    }


def test_intervals_are_of_metrics_and_of_nothing_else(case, tmp_path):
    task, truth, predictions = case
    summary = scored(tmp_path, task, truth, predictions)
    free = {
        f"{kind}.{name}"
        for kind, found in summary["matched"].items()
        for name in found
        if not name.startswith("n_")
    }
    assert "class_agnostic.label_accuracy" in free
    assert "class_aware.label_accuracy" not in free
    assert summary["intervals"].keys() == summary["metrics"].keys() | free


def test_a_category_that_nothing_is_of_changes_no_row(case, tmp_path):
    task, truth, predictions = case
    more = copy.deepcopy(truth)
    more["categories"].append({"id": 999, "name": "nothing", "frequency": "r"})
    before = scored(tmp_path / "a", task, truth, predictions)
    after = scored(tmp_path / "b", task, more, predictions)
    for key in ("metrics", "coverage", "matched"):
        assert after[key] == before[key]
    rows = [read_rows(tmp_path / k / "eval" / "per_category.jsonl") for k in "ab"]
    assert rows[1] == rows[0]
    assert after["counts"]["categories"] == before["counts"]["categories"] + 1


def test_every_json_file_ends_with_a_newline(case, tmp_path):
    scored(tmp_path, *case)
    names = [p for p in (tmp_path / "eval").rglob("*") if p.suffix in (".json", ".jsonl")]
    assert {p.name for p in names} >= {"truth.json", "predictions.json", "run.json", "summary.json"}
    for path in names:
        text = path.read_text()
        assert text.endswith("\n")
        assert not text.endswith("\n\n")


def test_the_view_holds_the_truth_s_own_fields(case, tmp_path):
    task, truth, predictions = case
    document = copy.deepcopy(truth)
    document["annotations"][0]["note"] = "not for a page"
    scored(tmp_path, task, document, predictions)
    viewed = json.loads((tmp_path / "eval" / "view" / "truth.json").read_text())
    of_page = {"id", "image_id", "category_id", "bbox", "segmentation", "area", "iscrowd", "ignore"}
    before = {a["id"]: a for a in truth["annotations"]}
    assert {a["id"] for a in viewed["annotations"]} == set(before)
    for shown in viewed["annotations"]:
        assert shown == {k: v for k, v in before[shown["id"]].items() if k in of_page}


def test_every_stage_is_announced(case, tmp_path):
    task, truth, predictions = case
    run = write_run(tmp_path / "run", task, truth, predictions)
    told = []
    evaluate_detections(
        run,
        write_truth(tmp_path / "truth.json", truth),
        tmp_path / "eval",
        evaluator="official",
        draws=3,
        notice=told.append,
    )
    once = [
        "checking the predictions",
        "matching",
        "running the evaluator",
        "3 tie orders",
        "3 bootstrap samples",
    ]
    assert list(dict.fromkeys(told)) == [*once, "the same predictions under equal confidence"]
    assert told.count("matching") == 2  # with the own scores, and with equal ones


def test_sizes_written_with_a_point_are_the_same_sizes(case, tmp_path):
    task, truth, predictions = case
    pointed = copy.deepcopy(truth)
    for image in pointed["images"]:
        image |= {"width": float(image["width"]), "height": float(image["height"])}
    for folder, document in (("a", truth), ("b", pointed)):
        evaluate(tmp_path / folder, task, truth, predictions, whole=document, draws=3)
    for name in ("summary.json", "per_image.jsonl", "view/truth.json", "view/predictions.json"):
        texts = [(tmp_path / folder / "eval" / name).read_text() for folder in "ab"]
        assert texts[0] == texts[1]


@pytest.mark.parametrize("key", ["image_id", "category_id"])
@pytest.mark.parametrize(("value", "shown"), [("10", "str"), (True, "bool"), (10.0, "float")])
def test_ids_that_are_no_integers_are_shown(key, value, shown, tmp_path):
    truth = random_truth("coco", seed=1)
    predictions = random_predictions("coco", truth, seed=1)
    predictions[7][key] = value
    with pytest.raises(LegoWorldError) as caught:
        evaluate(tmp_path, "coco", truth, predictions)
    assert f"found: expected int, got {shown} at $[7].{key};" in str(caught.value)


def rows_of(summary):
    tables = metric_tables([("", detection_metrics(summary))])
    return {row[0]: tuple(map(str, row[1:])) for table in tables for row in table.rows}


def test_the_words_beside_the_numbers(tmp_path):
    """One image, one category, one annotation: each count in the singular, and in the plural."""
    truth = {
        "images": [{"id": 1, "file_name": "1.jpg", "width": 64, "height": 64}],
        "categories": [{"id": 1, "name": "chair"}, {"id": 2, "name": "table"}],
        "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "bbox": [0, 0, 40, 40],
                         "area": 1600, "iscrowd": 0}],
    }  # fmt: skip
    predictions = [{"image_id": 1, "category_id": 1, "bbox": [0, 0, 40, 40], "score": 0.5}]
    found = evaluate(tmp_path / "one", "coco", truth, predictions)
    rows = rows_of(found)
    assert rows["AP"] == ("1.0000", "-", "1 image, 1 category, 1 annotation")
    assert rows["APs"] == ("-", "-", "1 image, 0 categories, 0 annotations")
    assert rows["class_aware.miou_matched"][2] == "1 pair"
    assert rows["class_aware.precision_50"][2] == "1 prediction"
    assert rows["class_agnostic.label_accuracy"][2] == "1 pair at IoU 0.5"
    assert rows["class_aware.pq"][2] == "1 annotation, 1 prediction"
    assert rows["class_aware.miou_gt_macro"][2] == "1 category"
    assert notes(found)[:3] == [
        "images: 1 ok; 0 scored without predictions",
        "ground truth: 1 instance in 1 of 2 categories, 0 crowd or ignored",
        "predictions: 1; 0 lost to the cap, 0 in unverified categories, 0 empty; 0 false positives "
        "in categories without ground truth here, not penalised",
    ]
    truth["images"].append({"id": 2, "file_name": "2.jpg", "width": 64, "height": 64})
    truth["annotations"] += [
        {**truth["annotations"][0], "id": 2, "image_id": 2, "category_id": 2},
        {**truth["annotations"][0], "id": 3, "image_id": 2, "category_id": 1, "area": 9},
    ]
    more = [*predictions, {**predictions[0], "image_id": 2, "score": 0.25}]
    found = evaluate(tmp_path / "two", "coco", truth, more)
    rows = rows_of(found)
    assert rows["AP"][2] == "2 images, 2 categories, 3 annotations"
    assert rows["APs"][2] == "2 images, 1 category, 1 annotation"
    equal = found.equal_confidence.metrics["AP"]
    over = "2 images, 2 categories"
    assert rows["equal_confidence.AP"] == (f"{equal:.4f}", "-", over)
    spread = found.equal_confidence.ties.spread
    assert rows["equal_confidence.AP over 20 tie orders"] == (
        f"{spread.expected:.4f}", f"sd {spread.sd:.4f}", "2 tied predictions",
    )  # fmt: skip
    bounds = f"[{spread.worst:.4f}, {spread.best:.4f}]"
    assert rows["equal_confidence.AP bounds over tie orders"] == ("-", bounds, over)
    low, high = found.intervals["AP"].ends
    assert rows["AP"][:2] == (f"{found.metrics['AP']:.4f}", f"[{low:.4f}, {high:.4f}]")


def boxes(*found):
    return [1] * len(found), [*found]


def test_boxes_of_a_pixel_are_no_fractions():
    assert check_box_format(*boxes([0, 0, 1, 1], [1, 1, 1, 1]), {1: (100, 80)}) == {}
    with pytest.raises(BoxFormatError, match="fractions of the image's size"):
        check_box_format(*boxes([0, 0, 1, 1], [0, 0, 0.5, 1]), {1: (100, 80)})
    with pytest.raises(BoxFormatError, match="fractions of the image's size"):
        check_box_format(*boxes([0, 0, 0.5, 1]), {1: (9, 9)})
    assert check_box_format(*boxes([0, 0, 0.5, 1]), {1: (8, 9)}) == {}
    assert check_box_format(*boxes([0, 0, 0.5, 1.25]), {1: (100, 80)}) == {}
    assert check_box_format([], [], {}) == {}


def test_oddities_of_boxes_are_counted():
    found = [[-2, 0, 5, 5], [-2.5, 0, 50, 5], [95, 70, 7, 12], [90, 0, 13, 9], [5, 5, 0, 9]]
    assert check_box_format([1] * 25, found * 5, {1: (100, 80)}) == {
        "boxes that leave their image by over 2 px": 10,
        "boxes without any area": 5,
    }


@pytest.fixture
def earlier(tmp_path):
    """A folder that says which evaluation it holds."""
    evidence = {"configuration": {"draws": 3, "long": "a" * 60}, "inputs": []}
    (tmp_path / EVIDENCE).write_text(json.dumps(evidence))
    return tmp_path


@pytest.mark.parametrize("name", [".hidden", "summary.txt", "view.json"])
def test_a_folder_with_another_file_is_never_touched(earlier, name):
    (earlier / name).write_text("mine")
    with pytest.raises(ConfigurationMismatchError, match=f"found: {name}; expected: an empty fold"):
        prepare_folder(earlier, configuration={}, inputs=[], overwrite=True)
