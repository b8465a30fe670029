"""COCO's instance masks: pycocotools' segm, held to it on shapes that are no rectangles."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from evaluation.detection_runs import checked, match_everything, read_rows, text_counts, write_run
from evaluation.official import direct_coco, evaluate
from pycocotools import mask as coco_mask

from legoworld.cli import run as call
from legoworld.evaluation.detection.matching.outcomes import (
    FALSE_POSITIVE,
    IGNORED,
    TRUE_POSITIVE,
)
from legoworld.track_making.make_track import make_track
from legoworld.tracks.track import load_track, serves

SIZE_HW = (90, 120)


def blob(random, *, holes):
    """A polygon of a star around a point, as a mask; perhaps with a hole that no polygon has."""
    angles = np.sort(random.random(9)) * 2 * np.pi
    radii = random.uniform(5, 30, 9)
    centre = random.uniform([25, 25], [95, 65])
    points = centre + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    pixels = np.zeros(SIZE_HW, np.uint8)
    cv2.fillPoly(pixels, [np.round(points).astype(np.int32)], 1)
    if holes:
        y, x = centre.astype(int)[::-1]
        pixels[y - 3 : y + 4, x - 3 : x + 4] = 0
    return np.clip(points, 0, [SIZE_HW[1], SIZE_HW[0]]).round(2), pixels


def rle(pixels):
    return text_counts(coco_mask.encode(np.asfortranarray(pixels)))


@pytest.fixture(scope="module")
def problem():
    """Truth of polygons and RLE crowds, and masks near and far, tied, empty, and with holes."""
    random = np.random.default_rng(0)
    truth = {
        "images": [
            {"id": 10 + 3 * i, "file_name": f"{i}.jpg", "width": 120, "height": 90}
            for i in range(25)
        ],
        "annotations": [],
        "categories": [{"id": 5 + 2 * k, "name": f"thing {k}"} for k in range(4)],
    }
    found = []
    for image in truth["images"]:
        for _ in range(int(random.integers(0, 7))):
            points, pixels = blob(random, holes=False)
            crowd = int(random.random() < 0.25)
            category = 5 + 2 * int(random.integers(4))
            x, y, w, h = (int(v) for v in coco_mask.toBbox(rle(pixels)))
            truth["annotations"].append(
                {
                    "id": len(truth["annotations"]) + 1,
                    "image_id": image["id"],
                    "category_id": category,
                    "iscrowd": crowd,
                    "bbox": [x, y, w, h],
                    "area": float(pixels.sum()),
                    "segmentation": rle(pixels) if crowd else [points.ravel().tolist()],
                }
            )
            for _ in range(int(random.integers(0, 4))):
                shifted = np.roll(pixels, random.integers(-4, 5, 2), (0, 1))
                shifted[random.random(SIZE_HW) < random.choice([0, 0.2])] = 0
                found.append((image["id"], category, shifted))
        found += [
            (image["id"], 5 + 2 * int(random.integers(4)), blob(random, holes=True)[1])
            for _ in range(int(random.integers(0, 3)))
        ]
        found.append((image["id"], 5, np.zeros(SIZE_HW, np.uint8)))
    predictions = [
        {"image_id": i, "category_id": c, "segmentation": rle(pixels),
         "score": float(random.integers(1, 6)) / 6}
        for i, c, pixels in found
    ]  # fmt: skip
    return truth, predictions


@pytest.mark.parametrize("kind", ["official", "fast"])
def test_all_twelve_numbers_are_pycocotools(problem, kind, tmp_path):
    truth, predictions = problem
    evaluation = evaluate(tmp_path, "coco-masks", truth, predictions, evaluator=kind)
    summary = evaluation
    _, _, ordered = checked(tmp_path / "again", "coco-masks", truth, predictions)
    numbers, _ = direct_coco(tmp_path / "truth.json", ordered.entries.results(), "segm")
    assert summary.official == pytest.approx(numbers, abs=1e-12)
    assert -1 not in summary.official[:4]
    assert summary.iou_type == "segm"
    boxes, _ = direct_coco(
        tmp_path / "truth.json",
        [
            {**p, "bbox": coco_mask.toBbox(p["segmentation"]).tolist()}
            for p in ordered.entries.documents()
        ],
        "bbox",
    )
    assert abs(boxes[0] - numbers[0]) > 0.01, "masks are not scored as their boxes"


def test_masks_without_a_pixel_are_false_positives_as_in_pycocotools(problem, tmp_path):
    """lvis drops them; pycocotools does not, and its number of the file is the file's number."""
    truth, predictions = problem
    summary = evaluate(tmp_path / "with", "coco-masks", truth, predictions)
    assert summary.counts.empty_masks_dropped == 0
    assert any(w.startswith("25 masks without a pixel") for w in summary.warnings)
    full = [p for p in predictions if coco_mask.area(p["segmentation"]) > 0]
    without = evaluate(tmp_path / "without", "coco-masks", truth, full)
    assert without.metrics["AP"] > summary.metrics["AP"]
    assert without.warnings == ()


def one(pixels_of_truths, pixels_of_detections, crowd=(0,)):
    """A truth and its predictions of one image and category."""
    truth = {
        "images": [{"id": 1, "file_name": "a.jpg", "width": 120, "height": 90}],
        "annotations": [
            {"id": n, "image_id": 1, "category_id": 5, "iscrowd": c, "area": float(p.sum()),
             "bbox": coco_mask.toBbox(rle(p)).tolist(), "segmentation": rle(p)}
            for n, (p, c) in enumerate(zip(pixels_of_truths, crowd, strict=True), start=1)
        ],
        "categories": [{"id": 5, "name": "thing"}],
    }  # fmt: skip
    predictions = [
        {"image_id": 1, "category_id": 5, "segmentation": rle(p), "score": 1 - n / 10}
        for n, p in enumerate(pixels_of_detections)
    ]
    return truth, predictions


def square(x, y, side):
    pixels = np.zeros(SIZE_HW, np.uint8)
    pixels[y : y + side, x : x + side] = 1
    return pixels


def test_a_crowd_forgives_by_the_share_of_the_detections_own_mask(tmp_path):
    """pycocotools' rule for masks: intersection over the detection's area, not over the union."""
    inside, half, outside = square(5, 5, 10), square(45, 5, 10), square(80, 60, 10)
    crowd = square(0, 0, 50)  # holds the first whole and half of the second
    regular = square(100, 70, 15)
    truth, predictions = one([crowd, regular], [inside, half, outside, regular], crowd=(1, 0))
    protocol, read, own = checked(tmp_path, "coco-masks", truth, predictions)
    _, table = match_everything(protocol, read, own)
    state = {int(e): int(s) for e, s in zip(table.entry, table.state[0, 0], strict=True)}
    outcome = {own.entries[e].score: s for e, s in state.items()}
    assert outcome == {1.0: IGNORED, 0.9: IGNORED, 0.8: FALSE_POSITIVE, 0.7: TRUE_POSITIVE}
    at_60 = dict(zip(table.entry.tolist(), table.state[0, 2].tolist(), strict=True))
    assert [at_60[e] for e in sorted(at_60, key=lambda e: -own.entries[e].score)][1] == (
        FALSE_POSITIVE
    ), "half of it is in the crowd: enough at 0.5, too little at 0.6"


def test_own_masks_as_truth_score_one(tmp_path):
    random = np.random.default_rng(3)
    shapes = [blob(random, holes=True)[1] for _ in range(6)]
    truth, predictions = one(shapes, shapes, crowd=(0,) * 6)
    summary = evaluate(tmp_path, "coco-masks", truth, predictions)
    assert summary.metrics["AP"] == pytest.approx(1.0)
    assert summary.matched.class_aware.pq == pytest.approx(1.0)


def test_a_track_of_coco_serves_both(problem, tmp_path):
    truth, _ = problem
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    made = [
        make_track(task, tmp_path / "truth.json", tmp_path / f"{task}.json", sample=5, seed=0)
        for task in ("coco", "coco-masks")
    ]
    assert made[0] == made[1]
    assert made[0].info.task == "coco"
    track = load_track(tmp_path / "coco.json")
    assert [serves(track, t) for t in ("coco", "coco-masks", "lvis", "eth3d")] == [
        True, True, False, False,
    ]  # fmt: skip


def test_the_whole_way_on_the_command_line(problem, tmp_path, capfd):
    """Import, evaluate twice with other workers, compare, verify, report: the same bytes."""
    truth, predictions = problem
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    (tmp_path / "masks.json").write_text(json.dumps(predictions))
    make_track("coco", tmp_path / "truth.json", tmp_path / "track.json", sample=None, seed=0)
    run = tmp_path / "run"
    words = ["baseline", "import", tmp_path / "masks.json", "--task", "coco-masks", "--track"]
    assert call([*map(str, [*words, tmp_path / "track.json", "-o", run])]) == 0
    assert [set(p) for p in json.loads((run / "predictions.json").read_text())[:1]] == [
        {"image_id", "category_id", "segmentation", "score"}
    ]
    scene = write_run(tmp_path / "scene_run", "coco-masks", truth, [
        {**p, "score": 1.0} for p in predictions if coco_mask.area(p["segmentation"])
    ])  # fmt: skip
    for folder, name, workers in ((run, "one", 1), (run, "two", 2), (scene, "scene", 1)):
        words = ["evaluate", folder, "--truth", tmp_path / "truth.json", "-o", tmp_path / name]
        assert call([*map(str, words), "--draws", "20", "--workers", str(workers)]) == 0
    for name in ("summary.json", "per_image.jsonl", "matches.npz"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    assert len(read_rows(tmp_path / "one" / "per_image.jsonl")) == 25
    assert call(["evidence", "verify", str(tmp_path / "one")]) == 0
    page = tmp_path / "report.html"
    assert call(["report", str(tmp_path / "one"), "-o", str(page)]) == 0
    assert "COCO masks" in page.read_text()
    capfd.readouterr()
