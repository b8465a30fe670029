"""Score-free numbers against trying every assignment, on truths with crowds and LVIS's gaps."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from evaluation.detection_runs import (
    checked,
    match_everything,
    random_predictions,
    random_truth,
)
from evaluation.test_bootstrap import pair_metrics
from pycocotools import mask as coco_mask

from legoworld.evaluation.pairing import best_pairs


def best_by_trying(iou):
    """The greatest total over all one-to-one assignments."""
    n, m = iou.shape
    if n > m:
        return best_by_trying(iou.T)
    return max(
        sum(iou[i, j] for i, j in enumerate(columns))
        for columns in itertools.permutations(range(m), n)
    )


@pytest.mark.parametrize("seed", range(30))
def test_pairs_reach_the_greatest_total(seed):
    random = np.random.default_rng(seed)
    iou = random.random(random.integers(1, 6, 2)) * (random.random() < 0.8)
    iou[random.random(iou.shape) < 0.4] = 0
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
