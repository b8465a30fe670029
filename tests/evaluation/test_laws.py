"""What must not change a score, and what must."""

from __future__ import annotations

import json
import random

import pytest
from evaluation.detection_runs import (
    evaluate_detections,
    random_predictions,
    random_truth,
    read_rows,
    write_run,
)
from evaluation.official import evaluate

from legoworld import cli
from legoworld.records.base import as_json
from legoworld.shipped.catalog import folder
from legoworld.tracks.vocabulary import find_dataset

TASKS = pytest.mark.parametrize("task", ["coco", "coco-masks", "lvis"])


def as_predictions(task, truth):
    payload = "bbox" if task == "coco" else "segmentation"
    return [
        {k: a[k] for k in ("image_id", "category_id", payload)} | {"score": 1.0}
        for a in truth["annotations"]
    ]


@TASKS
def test_the_truth_as_predictions_scores_one(task, tmp_path):
    truth = random_truth(task, seed=1)
    for a in truth["annotations"]:
        a["iscrowd"] = 0
    summary = evaluate(tmp_path, task, truth, as_predictions(task, truth))
    defined = [v for v in summary.metrics.values() if v is not None]
    expected = [k for k in summary.metrics if k not in ("AR1", "AR10")]
    assert len(defined) >= 9
    assert all(summary.metrics[k] in (None, pytest.approx(1.0)) for k in expected)
    assert summary.ties.worst == pytest.approx(1.0)
    for found in (summary.matched.class_aware, summary.matched.class_agnostic):
        assert found.pq == found.miou_gt_micro == found.f1_50 == pytest.approx(1.0)
    assert summary.matched.class_agnostic.label_accuracy == 1.0


@pytest.mark.parametrize("task", ["coco", "coco-masks", "lvis"])
def test_the_shipped_truth_scores_one_against_itself(task, tmp_path):
    path = folder("datasets") / "skimage_examples" / f"truth_{find_dataset(task)}.json"
    truth = json.loads(path.read_text(encoding="utf-8"))
    predictions = as_predictions(task, truth)
    if task != "coco":
        from legoworld.evaluation.detection.inputs.masks import compress_mask

        sizes = {i["id"]: (i["height"], i["width"]) for i in truth["images"]}
        for p in predictions:
            mask = compress_mask(p["segmentation"], sizes[p["image_id"]])
            p["segmentation"] = {
                "size": list(mask["size"]),
                "counts": mask["counts"].decode("ascii"),
            }
    run = write_run(tmp_path / "run", task, truth, predictions)
    evaluation = evaluate_detections(run, path, tmp_path / "eval", evaluator="official", draws=10)
    assert evaluation.metrics["AP"] == pytest.approx(1.0)
    assert evaluation.dataset_version == {"coco": "2017", "lvis": "1.0"}[find_dataset(task)]


@TASKS
@pytest.mark.parametrize("levels", [1, 3])
def test_a_shuffled_file_scores_the_same(task, levels, tmp_path):
    truth = random_truth(task, seed=2)
    predictions = random_predictions(task, truth, seed=2, levels=levels)
    first = evaluate(tmp_path / "a", task, truth, predictions)
    random.Random(1).shuffle(predictions)
    second = evaluate(tmp_path / "b", task, truth, predictions)
    assert first == second
    for name in ("summary.json", "per_image.jsonl", "per_category.jsonl", "matches.npz"):
        a, b = ((tmp_path / x / "eval" / name).read_bytes() for x in "ab")
        assert a == b, name


@TASKS
def test_other_ids_for_the_same_things_score_the_same(task, tmp_path):
    truth = random_truth(task, seed=7)
    predictions = random_predictions(task, truth, seed=7)
    first = evaluate(tmp_path / "a", task, truth, predictions)
    text = json.loads(json.dumps({"truth": truth, "predictions": predictions}))
    renamed = text["truth"]
    category = {c["id"]: 900 - c["id"] for c in renamed["categories"]}
    image = {i["id"]: 5000 - i["id"] for i in renamed["images"]}
    for c in renamed["categories"]:
        c["id"] = category[c["id"]]
    for i in renamed["images"]:
        i["id"] = image[i["id"]]
        for key in ("neg_category_ids", "not_exhaustive_category_ids"):
            if key in i:
                i[key] = [category[c] for c in i[key]]
    for n, a in enumerate([*renamed["annotations"], *text["predictions"]]):
        a["image_id"], a["category_id"] = image[a["image_id"]], category[a["category_id"]]
        if "id" in a:
            a["id"] = 10_000_000 - 17 * n
    second = evaluate(tmp_path / "b", task, renamed, text["predictions"])
    assert second.official == pytest.approx(first.official, abs=1e-12)
    for kind in ("class_aware", "class_agnostic"):
        found, expected = (as_json(getattr(s.matched, kind)) for s in (second, first))
        assert found == pytest.approx(expected, abs=1e-12)


@TASKS
def test_an_image_that_failed_stays_in_the_denominator(task, tmp_path):
    truth = random_truth(task, seed=8)
    predictions = random_predictions(task, truth, seed=8)
    failed = {i["id"] for i in truth["images"][::3]}
    left = [p for p in predictions if p["image_id"] not in failed]
    statuses = dict.fromkeys(failed, "missing")
    evaluation = evaluate(tmp_path, task, truth, left, statuses=statuses, draws=10)
    empty = evaluate(tmp_path / "empty", task, truth, left)
    assert evaluation.official == empty.official
    assert evaluation.coverage.attempted == 12
    assert evaluation.coverage.scored == 8
    assert empty.coverage.scored == 12
    assert evaluation.coverage.by_status == {"missing": 4, "ok": 8}
    rows = read_rows(tmp_path / "eval" / "per_image.jsonl")
    assert len(rows) == 12
    assert {r["image_id"] for r in rows if not r["scored"]} == failed
    subset = {**truth, "images": [i for i in truth["images"] if i["id"] not in failed]}
    subset["annotations"] = [a for a in truth["annotations"] if a["image_id"] not in failed]
    without = evaluate(tmp_path / "subset", task, subset, left)
    assert without.official != evaluation.official


@TASKS
def test_scoring_over_a_track_smaller_than_the_truth(task, tmp_path):
    """The run's images decide, not the truth's: as if the truth had no other."""
    truth = random_truth(task, seed=9, images=20)
    some = truth["images"][::2]
    wanted = {i["id"] for i in some}
    small = {
        **truth,
        "images": some,
        "annotations": [a for a in truth["annotations"] if a["image_id"] in wanted],
    }
    predictions = random_predictions(task, small, seed=9)
    alone = evaluate(tmp_path / "small", task, small, predictions)
    whole = evaluate(tmp_path, task, small, predictions, whole=truth)
    assert whole == alone


@TASKS
def test_scores_and_equal_confidence_side_by_side(task, tmp_path):
    truth = random_truth(task, seed=11)
    predictions = random_predictions(task, truth, seed=11)
    scored = evaluate(tmp_path / "a", task, truth, predictions)
    equal = evaluate(tmp_path / "b", task, truth, [{**p, "score": 0.7} for p in predictions])
    assert not scored.equal_confidence.already_equal
    assert equal.equal_confidence.already_equal
    assert scored.ties.sd == 0.0
    assert scored.ties.expected == pytest.approx(scored.metrics["AP"], abs=1e-12)
    assert scored.equal_confidence.official == equal.official
    assert scored.equal_confidence.ties == equal.ties
    assert equal.ties.sd > 0
    assert equal.ties.worst <= equal.metrics["AP"] <= equal.ties.best


def test_the_caps_are_counted(tmp_path):
    truth = random_truth("lvis", seed=12, images=2)
    predictions = random_predictions("lvis", truth, seed=12, per_image=320)
    summary = evaluate(tmp_path / "lvis", "lvis", truth, predictions)
    assert summary.counts.lost_to_cap == 40
    truth = random_truth("coco", seed=12, images=2, categories=2)
    predictions = [
        {**p, "category_id": 5} for p in random_predictions("coco", truth, seed=1, per_image=120)
    ]
    summary = evaluate(tmp_path / "coco", "coco", truth, predictions)
    assert summary.counts.lost_to_cap == 40


def test_false_positives_that_cost_nothing_are_counted(tmp_path):
    truth = random_truth("coco", seed=13, categories=6)
    truth["annotations"] = [a for a in truth["annotations"] if a["category_id"] != 5]
    predictions = random_predictions("coco", truth, seed=13)
    free = sum(p["category_id"] == 5 for p in predictions)
    with_them = evaluate(tmp_path / "a", "coco", truth, predictions)
    without = evaluate(
        tmp_path / "b", "coco", truth, [p for p in predictions if p["category_id"] != 5]
    )
    assert with_them.counts.false_positives_in_absent_categories == free > 0
    assert with_them.official == without.official


@TASKS
@pytest.mark.parametrize("kind", ["official", "fast"])
def test_images_without_any_truth(task, kind, tmp_path):
    truth = random_truth(task, seed=14)
    predictions = random_predictions(task, truth, seed=14)
    truth["annotations"] = []
    summary = evaluate(tmp_path, task, truth, predictions, evaluator=kind)
    assert set(summary.official) == {-1.0}
    assert set(summary.metrics.values()) == {None}
    assert summary.ties.expected is None
    assert summary.matched.class_aware.miou_gt_micro is None
    assert all(x.low is None for x in summary.intervals.values() if x.draws)
    assert summary.coverage.with_truth == 0
    assert cli.run(["evidence", "verify", str(tmp_path / "eval")]) == 0


def test_predictions_nobody_verified_are_dropped_and_counted(tmp_path):
    truth = random_truth("lvis", seed=15)
    for image in truth["images"]:
        image["neg_category_ids"] = []
    present = {(a["image_id"], a["category_id"]) for a in truth["annotations"]}
    predictions = random_predictions("lvis", truth, seed=15)
    strangers = [p for p in predictions if (p["image_id"], p["category_id"]) not in present]
    summary = evaluate(tmp_path / "a", "lvis", truth, strangers)
    assert summary.counts.unverified_dropped == len(strangers) > 0
    assert summary.metrics["AP"] == 0.0
    assert summary.matched.class_aware.n_dt == 0
    whole = evaluate(tmp_path / "b", "lvis", truth, predictions)
    kept = [p for p in predictions if (p["image_id"], p["category_id"]) in present]
    assert evaluate(tmp_path / "c", "lvis", truth, kept).official == whole.official


def test_a_single_image_has_no_interval(tmp_path):
    truth = random_truth("coco", seed=16, images=1, per_image=5)
    assert truth["annotations"]
    summary = evaluate(tmp_path, "coco", truth, as_predictions("coco", truth))
    assert summary.metrics["AP"] is not None
    assert all(x.low is None for x in summary.intervals.values())
