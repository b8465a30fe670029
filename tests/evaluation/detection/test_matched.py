"""Score-free numbers against trying every assignment, on truths with crowds and LVIS's gaps."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from evaluation.detection_runs import (
    box_mask,
    checked,
    match_everything,
    random_predictions,
    random_truth,
    text_counts,
)
from evaluation.made_chunks import best_pairs
from evaluation.reference_resampling import pair_metrics
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from pycocotools import mask as coco_mask

from legoworld.evaluation.detection.evaluators import run_evaluator
from legoworld.evaluation.detection.grid import PICTURE
from legoworld.evaluation.detection.matching.outcomes import (
    FALSE_POSITIVE,
    IGNORED,
    TRUE_POSITIVE,
)
from legoworld.evaluation.detection.ranking.accumulation import accumulate, metric_value
from legoworld.evaluation.detection.scoring import category_frequencies


def best_by_trying(iou):
    """The greatest total over all one-to-one assignments."""
    n, m = iou.shape
    if n > m:
        return best_by_trying(iou.T)
    return max(
        sum(iou[i, j] for i, j in enumerate(columns))
        for columns in itertools.permutations(range(m), n)
    )


#: Thousandths: no total is so close to another that the preference for hits could decide.
OVERLAPS = arrays.arrays(
    np.float64,
    st.tuples(st.integers(1, 5), st.integers(1, 5)),
    elements=st.integers(0, 1000).map(lambda n: n / 1000),
)


@settings(max_examples=50)
@given(OVERLAPS)
def test_pairs_reach_the_greatest_total(iou):
    rows, columns = best_pairs(iou, np.zeros(iou.shape, bool))
    assert len(set(rows)) == len(rows)
    assert len(set(columns)) == len(columns)
    assert (iou[rows, columns] > 0).all()
    assert iou[rows, columns].sum() == pytest.approx(best_by_trying(iou), abs=1e-12)


def test_of_equal_totals_the_right_label_is_paired():
    for same in ([[True, False], [False, True]], [[False, True], [True, False]]):
        rows, columns = best_pairs(np.full((2, 2), 0.8), np.array(same))
        assert np.array(same)[rows, columns].all()


def by_hand(task, truth, predictions, *, class_aware):
    """The definitions, written out: sums over images of exhaustively found assignments."""
    sums = dict.fromkeys(("iou", "pairs", "hits", "right", "gt", "dt"), 0.0)
    for image in truth["images"]:
        true = [a for a in truth["annotations"] if a["image_id"] == image["id"]]
        mine = [p for p in predictions if p["image_id"] == image["id"]]
        groups = (
            [None]
            if not class_aware
            else sorted({a["category_id"] for a in truth["annotations"] + predictions})
        )
        present = {a["category_id"] for a in true}
        verified = present | set(image.get("neg_category_ids", [])) if task == "lvis" else None
        for group in groups:
            t = [a for a in true if group in (None, a["category_id"])]
            d = [p for p in mine if group in (None, p["category_id"])]
            if class_aware and verified is not None:
                d = [p for p in d if p["category_id"] in verified]
            regular = [a for a in t if not a.get("iscrowd")]
            crowd = [a for a in t if a.get("iscrowd")]
            iou = overlap(task, d, regular, 0)
            pairs = assigned(iou, d, regular)
            sums["gt"] += len(regular)
            for k, p in enumerate(d):
                pair = next((j for i, j in pairs if i == k), None)
                value = 0.0 if pair is None else iou[k, pair]
                sums["iou"] += value
                sums["pairs"] += value > 0
                sums["hits"] += value >= 0.5
                sums["right"] += value >= 0.5 and p["category_id"] == regular[pair]["category_id"]
                forgiven = bool(crowd) and overlap(task, [p], crowd, 1).max() >= 0.5
                if task == "lvis":
                    forgiven |= p["category_id"] not in verified
                    forgiven |= p["category_id"] in image["not_exhaustive_category_ids"]
                sums["dt"] += value >= 0.5 or not forgiven
    return sums


def overlap(task, d, t, crowd):
    if not d or not t:
        return np.zeros((len(d), len(t)))
    key = "bbox" if task == "coco" else "segmentation"
    shapes = [
        [
            x[key] if task == "coco" else {**x[key], "counts": x[key]["counts"].encode()}
            for x in side
        ]
        for side in (d, t)
    ]
    return np.asarray(coco_mask.iou(*shapes, [crowd] * len(t)))


def assigned(iou, d, t):
    """Pairs of the assignment of greatest total; then most hits; then most right labels."""
    n, m = iou.shape
    if not n or not m:
        return []
    best, pairs = (-1.0, 0, 0), []
    for rows in itertools.permutations(range(n), min(n, m)):
        for columns in [range(m)] if m <= n else itertools.permutations(range(m), n):
            chosen = [(i, j) for i, j in zip(rows, columns, strict=False) if iou[i, j] > 0]
            hits = [(i, j) for i, j in chosen if iou[i, j] >= 0.5]
            right = sum(d[i]["category_id"] == t[j]["category_id"] for i, j in hits)
            key = (round(sum(iou[i, j] for i, j in chosen), 9), len(hits), right)
            if key > best:
                best, pairs = key, chosen
        if m > n:
            break
    return pairs


@pytest.mark.parametrize("class_aware", [True, False])
@pytest.mark.parametrize("task", ["coco", "lvis"])
@pytest.mark.parametrize("seed", range(4))
def test_the_numbers_are_their_definitions(task, class_aware, seed, tmp_path):
    truth = random_truth(task, seed=seed, images=6, categories=3, per_image=4)
    raw = random_predictions(task, truth, seed=seed, per_image=5, levels=1)
    protocol, read, predictions = checked(tmp_path, task, truth, raw)
    problem, _ = match_everything(protocol, read, predictions)
    whole = np.ones((1, 6), np.int32)
    found = pair_metrics(problem, read, predictions, whole, class_aware=class_aware)
    found = {name: float(value[0]) for name, value in found.items()}
    sums = by_hand(task, truth, raw, class_aware=class_aware)
    assert (found["n_gt"], found["n_dt"], found["n_matched"], found["n_hits_50"]) == (
        sums["gt"], sums["dt"], sums["pairs"], sums["hits"],
    )  # fmt: skip
    assert found["miou_gt_micro"] == pytest.approx(sums["iou"] / sums["gt"])
    assert found["miou_matched"] == pytest.approx(sums["iou"] / sums["pairs"])
    assert found["precision_50"] == pytest.approx(sums["hits"] / sums["dt"])
    assert found["f1_50"] == pytest.approx(2 * sums["hits"] / (sums["dt"] + sums["gt"]))
    assert found["label_accuracy"] == pytest.approx(sums["right"] / sums["hits"])
    assert found["pq"] == pytest.approx(found["sq"] * found["rq"])


def test_flooding_and_abstaining_are_seen_beside_the_mean(tmp_path):
    """Many boxes raise mIoU over truths and sink precision; one sure box does the opposite."""
    truth = random_truth("coco", seed=40, images=8)
    for a in truth["annotations"]:
        a["iscrowd"] = 0
    flood = random_predictions("coco", truth, seed=40, per_image=60, levels=1)
    one = [
        {"image_id": a["image_id"], "category_id": a["category_id"], "bbox": a["bbox"], "score": 1}
        for a in truth["annotations"][:1]
    ]
    found = []
    for name, raw in (("flood", flood), ("one", one)):
        protocol, read, predictions = checked(tmp_path / name, "coco", truth, raw)
        problem, _ = match_everything(protocol, read, predictions)
        whole = np.ones((1, 8), np.int32)
        found.append(pair_metrics(problem, read, predictions, whole, class_aware=True))
    assert found[0]["miou_gt_micro"] > found[1]["miou_gt_micro"]
    assert found[0]["precision_50"] < 0.3 < found[1]["precision_50"]
    assert found[1]["miou_matched"] == 1.0
    assert found[1]["n_matched"] == 1


def one_lvis_image(annotations, predictions, tmp_path):
    """(class-aware, class-agnostic) numbers and lvis's own counts of one image, boxes as masks."""
    truth = random_truth("lvis", seed=0, images=1, per_image=0, categories=2)
    image = truth["images"][0]
    image |= {"neg_category_ids": [], "not_exhaustive_category_ids": []}
    masks = [text_counts(box_mask(box)) for box, *_ in annotations]
    truth["annotations"] = [
        {"id": n, "image_id": image["id"], "category_id": category, "bbox": box,
         "segmentation": mask, "area": float(box[2] * box[3]), "ignore": int(ignore)}
        for n, ((box, category, ignore), mask) in enumerate(
            zip(annotations, masks, strict=True), start=1)
    ]  # fmt: skip
    entries = [
        {"image_id": image["id"], "category_id": category, "score": 0.9 - 0.01 * k,
         "segmentation": text_counts(box_mask(box))}
        for k, (box, category) in enumerate(predictions)
    ]  # fmt: skip
    protocol, read, found = checked(tmp_path, "lvis", truth, entries)
    problem, table = match_everything(protocol, read, found)
    whole = np.ones((1, 1), np.int32)
    numbers = [
        {k: v[0] for k, v in pair_metrics(problem, read, found, whole, class_aware=aware).items()}
        for aware in (True, False)
    ]
    return *numbers, int((table.state[0, 0] != IGNORED).sum())


def test_an_ignored_truth_of_lvis_forgives_one_detection_as_in_lvis(tmp_path):
    ignored, regular = [10, 10, 20, 20], [60, 40, 20, 20]
    annotations = [(ignored, 5, True), (regular, 5, False)]
    for n, predictions in enumerate(
        (
            [(ignored, 5)],
            [(ignored, 5), ([11, 10, 20, 20], 5)],
            [(regular, 5), (ignored, 5), ([11, 10, 20, 20], 5), ([90, 60, 20, 20], 5)],
            [(regular, 5)],
        )
    ):
        aware, agnostic, answered = one_lvis_image(annotations, predictions, tmp_path / str(n))
        assert aware["n_gt"] == agnostic["n_gt"] == 1
        assert aware["n_dt"] == agnostic["n_dt"] == answered == (0, 1, 3, 1)[n]


def test_ignored_truths_forgive_as_many_detections_as_they_can(tmp_path):
    """The one detection that overlaps both is not given the truth that another one needs."""
    annotations = [([10, 10, 20, 20], 5, True), ([16, 10, 20, 20], 5, True)]
    predictions = [([13, 10, 20, 20], 5), ([18, 10, 20, 20], 5)]
    aware, _, _ = one_lvis_image(annotations, predictions, tmp_path)
    assert aware["n_dt"] == 0
    aware, agnostic, _ = one_lvis_image(annotations, [([13, 10, 20, 20], 7)], tmp_path / "other")
    assert aware["n_dt"] == agnostic["n_dt"] == 0  # not verified here; on something ignored


def test_a_crowd_forgives_from_half_of_the_detection_on_and_any_number(tmp_path):
    truth = random_truth("coco", seed=0, images=1, per_image=0, categories=1)
    image = truth["images"][0]["id"]
    truth["annotations"] = [
        {"id": 1, "image_id": image, "category_id": 5, "bbox": [0, 0, 50, 50], "area": 2500.0,
         "segmentation": [], "iscrowd": 1},
    ]  # fmt: skip
    for outside, counted in ((0, 0), (9, 0), (10, 0), (11, 1), (20, 1)):
        # 20 px wide, so many of them outside the crowd: the share inside decides.
        boxes = [[50 - (20 - outside), 10 * k, 20, 10] for k in range(3)]
        entries = [
            {"image_id": image, "category_id": 5, "bbox": box, "score": 0.5} for box in boxes
        ]
        protocol, read, found = checked(tmp_path / str(outside), "coco", truth, entries)
        problem, table = match_everything(protocol, read, found)
        whole = np.ones((1, 1), np.int32)
        for aware in (True, False):
            numbers = pair_metrics(problem, read, found, whole, class_aware=aware)
            assert numbers["n_dt"][0] == 3 * counted
        share = (20 - outside) / 20
        expected = [IGNORED if share >= t else FALSE_POSITIVE for t in PICTURE.iou]
        assert (table.state[0] == np.array(expected)[:, None]).all()


@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_of_equal_overlaps_the_later_truth_is_taken_as_in_the_official_evaluators(task, tmp_path):
    """The first detection lies half way between two truths; the second one on one of these."""
    truth = random_truth(task, seed=0, images=1, per_image=0, categories=2)
    image = truth["images"][0]
    image |= {"neg_category_ids": [], "not_exhaustive_category_ids": []}
    left, right = [10, 10, 40, 40], [30, 10, 40, 40]

    def shape(box):
        return {"image_id": image["id"], "category_id": 5, "bbox": box,
                "segmentation": text_counts(box_mask(box))}  # fmt: skip

    entries = [{**shape([20, 10, 40, 40]), "score": 0.9}, {**shape([2, 10, 40, 40]), "score": 0.5}]
    for n, (boxes, n_true) in enumerate((((left, right), 2), ((right, left), 1))):
        truth["annotations"] = [
            {**shape(box), "id": k, "area": 1600.0, "iscrowd": 0} for k, box in enumerate(boxes, 1)
        ]
        protocol, read, found = checked(tmp_path / str(n), task, truth, entries)
        _, table = match_everything(protocol, read, found)
        assert (table.state[0, 0] == TRUE_POSITIVE).sum() == n_true
        curves = accumulate(table, protocol)
        ours = [metric_value(m, curves, category_frequencies(read)) for m in protocol.metrics]
        scores = run_evaluator(read, found, protocol, "official")
        assert ours == pytest.approx(scores.official, abs=1e-12)


def test_an_overlap_of_exactly_half_is_a_hit_and_no_match_of_panoptic_quality(tmp_path):
    """COCO counts IoU >= .5; PQ takes IoU > .5 (Kirillov et al., CVPR 2019, section 4.1)."""
    truth = {
        "images": [{"id": 1, "file_name": "a.jpg", "width": 120, "height": 90}],
        "categories": [{"id": 5, "name": "thing", "frequency": "f"}],
        "annotations": [
            {"id": i, "image_id": 1, "category_id": 5, "bbox": [x, 0, 10, 10], "area": 100,
             "iscrowd": 0, "segmentation": [[x, 0, x + 10, 0, x + 10, 10, x, 10]]}
            for i, x in enumerate((0, 50), start=1)
        ],
    }  # fmt: skip
    found = [
        {"image_id": 1, "category_id": 5, "score": 1.0, "bbox": [0, 0, 10, 5]},
        {"image_id": 1, "category_id": 5, "score": 1.0, "bbox": [50, 0, 10, 6]},
    ]
    protocol, read, predictions = checked(tmp_path, "coco", truth, found)
    problem, _ = match_everything(protocol, read, predictions)
    once = np.ones((1, 1), np.int32)
    numbers = pair_metrics(problem, read, predictions, once, class_aware=True)
    assert [float(numbers[name][0]) for name in ("recall_50", "precision_50")] == [1.0, 1.0]
    assert float(numbers["rq"][0]) == 0.5
    assert float(numbers["pq"][0]) == pytest.approx(0.3)
