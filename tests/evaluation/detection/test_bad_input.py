"""Whatever would make a wrong number is an error of one line, or a counted warning."""

from __future__ import annotations

import copy
import json

import numpy as np
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
from pycocotools import mask as coco_mask

from legoworld import cli
from legoworld.errors import ConfigurationMismatchError, LegoWorldError
from legoworld.evaluation.detection.inputs.box_formats import check_box_format
from legoworld.evaluation.detection.inputs.masks import measure_masks, rle_problem
from legoworld.shipped.catalog import folder


def refused(tmp_path, task, truth, predictions, match):
    with pytest.raises(LegoWorldError, match=match) as caught:
        evaluate(tmp_path, task, truth, predictions)
    assert "\n" not in str(caught.value)
    assert not list((tmp_path / "eval").glob("*"))


PREDICTION_FAULTS = {
    "a NaN score": ("coco", {"score": float("nan")}, "not JSON: NaN"),
    "an infinite score": ("coco", {"score": float("inf")}, "not JSON: NaN, infinity"),
    "a score in words": ("coco", {"score": "0.9"}, r"got str at \$\[7\].score"),
    "no score": ("coco", {"score": None}, r"got null at \$\[7\].score"),
    "an unknown image": ("coco", {"image_id": 999}, "image 999"),
    "an image id in words": ("coco", {"image_id": "10"}, r"expected int, got str at \$\[7\]"),
    "an unknown category": ("coco", {"category_id": 999}, "999"),
    "three numbers": ("coco", {"bbox": [1, 2, 3]}, r"expected array of length 4 at \$\[7\].bbox"),
    "a score no float holds": ("coco", {"score": 10**400}, "score"),
    "a NaN box": ("coco", {"bbox": [1, 2, 3, float("nan")]}, "not JSON: NaN"),
    "a negative width": ("coco", {"bbox": [9, 9, -3, 4]}, "x, y, width, height"),
    "a polygon": ("lvis", {"segmentation": [[1, 1, 5, 1, 5, 5]]}, "expected object, got array"),
    "another size": ("lvis", {"segmentation": {"size": [9, 9], "counts": "a"}}, "size"),
    "cut counts": ("lvis", {"segmentation": {"size": [90, 120], "counts": "11"}}, "run lengths"),
    "foreign counts": ("lvis", {"segmentation": {"size": [90, 120], "counts": "é!"}}, "run length"),
    "half a character": (
        "lvis",
        {"segmentation": {"size": [90, 120], "counts": "\ud800"}},
        "half of a surrogate pair",
    ),
    "counts too short": ("lvis", {"segmentation": {"size": [90, 120], "counts": [5, 5]}}, "10800"),
}


@pytest.mark.parametrize("name", PREDICTION_FAULTS)
def test_one_wrong_prediction(name, tmp_path):
    task, change, match = PREDICTION_FAULTS[name]
    truth = random_truth(task, seed=1)
    predictions = random_predictions(task, truth, seed=1)
    predictions[7] |= change
    refused(tmp_path, task, truth, predictions, match)


@pytest.mark.parametrize("key", ["image_id", "category_id", "score", "bbox"])
def test_a_missing_key(key, tmp_path):
    truth = random_truth("coco", seed=1)
    predictions = random_predictions("coco", truth, seed=1)
    del predictions[3][key]
    match = rf"missing required field {key} at \$\[3\]"
    refused(tmp_path, "coco", truth, predictions, match)


def test_positions_instead_of_cocos_ids_are_named(tmp_path):
    categories = json.loads((folder("datasets") / "coco" / "categories.json").read_text())
    truth = {**random_truth("coco", seed=1), "categories": categories, "annotations": []}
    for first in (0, 1):
        predictions = [
            {"image_id": 10, "category_id": k + first, "bbox": [1, 1, 5, 5], "score": 1.0}
            for k in range(80)
        ]
        match = f"positions {first}..{first + 79}, not the dataset's ids 1..90"
        refused(tmp_path, "coco", truth, predictions, match)


def boxes_as(form):
    truth = random_truth("coco", seed=2, images=30)
    entries = random_predictions("coco", truth, seed=2)
    for e in entries:
        x, y, w, h = e["bbox"]
        e["bbox"] = {
            "corners": [x, y, x + w, y + h],
            "centre": [x + w / 2, y + h / 2, w, h],
            "fractions": [x / 120, y / 90, w / 120, h / 90],
            "xywh": [x, y, w, h],
        }[form]
    return truth, entries


@pytest.mark.parametrize(
    ("form", "hint"),
    [("corners", "x1, y1, x2, y2"), ("centre", "centre x"), ("fractions", "fractions")],
)
def test_boxes_in_another_format_are_named(form, hint, tmp_path):
    refused(tmp_path, "coco", *boxes_as(form), hint)


def box_oddities(entries, sizes):
    ids, boxes = [e["image_id"] for e in entries], [e["bbox"] for e in entries]
    return check_box_format(ids, boxes, sizes)


def test_a_format_is_named_only_where_every_box_fits_it():
    truth, entries = boxes_as("centre")
    sizes = {i["id"]: (120, 90) for i in truth["images"]}
    with pytest.raises(LegoWorldError, match="these look like centre x"):
        box_oddities(entries, sizes)
    astray = {**entries[0], "bbox": [110, 80, 100, 100]}  # 60..160 of 120 px
    assert list(box_oddities([*entries, astray], sizes)) == [
        "boxes that leave their image by over 2 px"
    ]


def test_boxes_in_the_right_format_are_never_suspected():
    truth, entries = boxes_as("xywh")
    sizes = {i["id"]: (120, 90) for i in truth["images"]}
    random = np.random.default_rng(0)
    for _ in range(300):
        some = [entries[i] for i in random.integers(0, len(entries), random.integers(1, 9))]
        assert box_oddities(some, sizes) == {}
    lone = [{"image_id": 10, "bbox": [0, 0, 1, 1]}, {"image_id": 10, "bbox": [100, 60, 24, 34]}]
    assert box_oddities(lone, sizes) == {"boxes that leave their image by over 2 px": 1}


def test_the_id_zero_that_the_official_evaluator_loses_is_repaired_and_counted(tmp_path):
    truth = random_truth("coco", seed=3)
    predictions = random_predictions("coco", truth, seed=3)
    whole = evaluate(tmp_path / "a", "coco", truth, predictions)
    truth["annotations"][0]["id"] = 0
    again = evaluate(tmp_path / "b", "coco", truth, predictions)
    assert again.official == whole.official
    assert any("annotation id 0" in w for w in again.warnings)


def test_uncompressed_masks_are_compressed_and_counted(tmp_path):
    truth = random_truth("lvis", seed=4)
    predictions = random_predictions("lvis", truth, seed=4)
    whole = evaluate(tmp_path / "a", "lvis", truth, predictions)
    for p in predictions[:5]:
        p["segmentation"]["counts"] = runs_of(p["segmentation"])
    again = evaluate(tmp_path / "b", "lvis", truth, predictions)
    assert again.official == whole.official
    assert any(w.startswith("5 masks with uncompressed") for w in again.warnings)


def test_a_box_beside_a_mask_is_left_out_and_counted(tmp_path):
    truth = random_truth("lvis", seed=4)
    predictions = random_predictions("lvis", truth, seed=4)
    whole = evaluate(tmp_path / "a", "lvis", truth, predictions)
    boxed = [{**p, "bbox": [0, 0, 1, 1]} for p in predictions[:7]] + predictions[7:]
    again = evaluate(tmp_path / "b", "lvis", truth, boxed)
    assert again.official == whole.official
    assert "7 masks with a bbox, which was left out" in again.warnings


def test_masks_without_a_pixel_are_dropped_and_counted(tmp_path):
    truth = random_truth("lvis", seed=5)
    predictions = random_predictions("lvis", truth, seed=5)
    empty = {**predictions[0], "segmentation": {"size": [90, 120], "counts": [90 * 120]}}
    summary = evaluate(tmp_path, "lvis", truth, [*predictions, empty])
    assert summary.counts.empty_masks_dropped == 1


def runs_of(mask):
    """Uncompressed counts of a compressed mask, by way of its pixels."""
    pixels = coco_mask.decode(mask).flatten(order="F")
    edges = np.flatnonzero(np.diff(pixels, prepend=0, append=1 - pixels[-1]))
    return np.diff(edges, prepend=0).tolist()


def covered_by(texts):
    return measure_masks(texts)[0]


def encoded(pixels):
    return coco_mask.encode(np.asfortranarray(pixels.astype(np.uint8)))["counts"].decode()


def test_counts_of_whole_masks_cover_their_image_and_cut_ones_do_not():
    random = np.random.default_rng(0)
    sizes = [tuple(random.integers(1, 90, 2)) for _ in range(1500)]
    texts = [encoded(random.random(size) < random.random()) for size in sizes]
    pixels = np.array([h * w for h, w in sizes])
    np.testing.assert_array_equal(covered_by(texts), pixels)
    assert (covered_by([t[:-1] for t in texts]) != pixels).all()
    assert (covered_by([t[:-1] + "~" for t in texts]) == -1).all()
    assert (covered_by([t + "\u00e9" for t in texts]) == -1).all()
    assert covered_by(["", "0", "P", "PPPPPPPPPP0"]).tolist() == [-1, 0, -1, -1]
    assert covered_by([]).shape == (0,)


def test_one_unusable_text_leaves_its_neighbours_as_they_are():
    whole = encoded(np.eye(30) > 0)
    for bad in ("", "P", "~", whole[:-1], encoded(np.eye(30) > 0)[::-1]):
        covered = covered_by([whole, bad, whole, bad, bad, whole])
        assert covered[[0, 2, 5]].tolist() == [900, 900, 900], bad
        assert (covered[[1, 3, 4]] != 900).all(), bad


def test_negative_runs_are_no_run_lengths():
    # 5, 3, -2 as pycocotools would write them: the sixth bit of -2's only character is its sign.
    assert covered_by(["53N"]).tolist() == [-1]
    assert covered_by(["532"]).tolist() == [10]


def test_a_list_of_counts_is_held_to_its_image():
    assert rle_problem({"size": [2, 5], "counts": [4, 6]}, (5, 2)) is None
    for counts in ([], [4, 5], [-1, 11], [4.0, 6.0], None):
        assert rle_problem({"size": [2, 5], "counts": counts}, (5, 2)) is not None


TRUTH_FAULTS = {
    "no annotations": (lambda t: t.pop("annotations"), "has no annotations"),
    "an unknown image": (lambda t: t["images"].pop(2), "not in the truth"),
    "another size": (lambda t: t["images"][2].update(width=121), "another size"),
    "another photo": (lambda t: t["images"][2].update(file_name="x.jpg"), "another photo"),
    "other categories": (lambda t: t["categories"][0].update(name="x"), "different categories"),
    "another version": (lambda t: t["categories"].pop(), "different categories"),
    "an unknown category": (lambda t: t["annotations"][1].update(category_id=1), "category_id 1;"),
    "no box": (lambda t: t["annotations"][1].update(bbox=[1, 2]), "bbox"),
    "no area": (lambda t: t["annotations"][1].pop("area"), "area"),
    "ids twice": (lambda t: t["annotations"][1].update(id=1), "repeat"),
}


@pytest.mark.parametrize("name", TRUTH_FAULTS)
def test_a_truth_that_cannot_be_scored_against(name, tmp_path):
    change, match = TRUTH_FAULTS[name]
    truth = random_truth("coco", seed=6)
    predictions = random_predictions("coco", truth, seed=6)
    run = write_run(tmp_path / "run", "coco", truth, predictions)
    broken = copy.deepcopy(truth)
    change(broken)
    path = write_truth(tmp_path / "truth.json", broken)
    with pytest.raises(LegoWorldError, match=match):
        evaluate_detections(run, path, tmp_path / "eval", evaluator="fast", draws=5)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda t: t["images"][1].pop("neg_category_ids"), "verified categories"),
        (lambda t: t["categories"][1].update(frequency="x"), "frequency"),
        (lambda t: t["annotations"][1]["segmentation"].update(size=[9, 9]), "RLE size"),
        (lambda t: t["annotations"][1].pop("segmentation"), "no segmentation"),
    ],
)
def test_an_lvis_truth_that_cannot_be_scored_against(change, match, tmp_path):
    truth = random_truth("lvis", seed=6)
    predictions = random_predictions("lvis", truth, seed=6)
    broken = copy.deepcopy(truth)
    change(broken)
    run = write_run(tmp_path / "run", "lvis", truth, predictions)
    path = write_truth(tmp_path / "truth.json", broken)
    arguments = ["evaluate", str(run), "--truth", str(path), "-o", str(tmp_path / "eval")]
    assert cli.run(arguments) == 2


@pytest.mark.real_data
def test_lvis_versions_do_not_mix(real_data, tmp_path, capsys):
    truth = json.loads((folder("datasets") / "skimage_examples/truth_lvis.json").read_text())
    run = write_run(tmp_path / "run", "lvis", truth, [])
    old = real_data / "lvis" / "lvis_val_100.json"
    arguments = ["evaluate", str(run), "--truth", str(old), "-o", str(tmp_path / "eval")]
    assert cli.run(arguments) == 2
    assert "1,230 categories, version 0.5" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("damage", "match"),
    [
        (lambda run: (run / "journal.jsonl").write_text(""), "is unfinished"),
        (lambda run: (run / "run.json").unlink(), "run.json cannot be read"),
        (lambda run: (run / "per_image.jsonl").write_text(""), "does not cover"),
        (lambda run: (run / "predictions.json").write_text("{}"), "expected array, got object"),
        (
            lambda run: (run / "predictions.json").write_text("[1]"),
            "expected object, got int at $[0]",
        ),
        (lambda run: (run / "predictions.json").write_text("["), "predictions.json cannot"),
    ],
)
def test_a_damaged_run(damage, match, tmp_path, capsys):
    truth = random_truth("coco", seed=1)
    run = write_run(tmp_path / "run", "coco", truth, [])
    damage(run)
    path = write_truth(tmp_path / "truth.json", truth)
    arguments = ["evaluate", str(run), "--truth", str(path), "-o", str(tmp_path / "eval")]
    assert cli.run(arguments) == 2
    error = capsys.readouterr().err
    assert match in error
    assert error.count("\n") == 1


HALF = "half \ud800"


@pytest.mark.parametrize("where", ["row", "run.json", "truth image", "truth category"])
def test_half_a_surrogate_pair_in_a_name_is_one_line(where, tmp_path, capsys):
    truth = random_truth("coco", seed=1)
    run = write_run(tmp_path / "run", "coco", truth, [])
    if where == "row":
        rows = read_rows(run / "per_image.jsonl")
        lines = [json.dumps({**row, "file_name": HALF}) + "\n" for row in rows]
        (run / "per_image.jsonl").write_text("".join(lines))
    elif where == "run.json":
        document = json.loads((run / "run.json").read_text())
        document["configuration"]["baseline"] = HALF
        (run / "run.json").write_text(json.dumps(document))
    else:
        truth["images" if where == "truth image" else "categories"][0][
            "file_name" if where == "truth image" else "name"
        ] = HALF
    path = write_truth(tmp_path / "truth.json", truth)
    arguments = ["evaluate", str(run), "--truth", str(path), "-o", str(tmp_path / "eval")]
    assert cli.run([*arguments, "--draws", "2"]) == 2
    error = capsys.readouterr().err
    assert "half of a surrogate pair" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "eval" / "summary.json").exists()


def test_a_pair_of_surrogates_is_a_character_of_a_name(tmp_path):
    truth = random_truth("coco", seed=1)
    truth["images"][0]["file_name"] = "\N{GRINNING FACE}.jpg"
    assert evaluate(tmp_path, "coco", truth, []).coverage.attempted == len(truth["images"])


def test_predictions_of_an_unread_image_are_refused(tmp_path):
    truth = random_truth("coco", seed=1)
    predictions = random_predictions("coco", truth, seed=1)
    run = write_run(tmp_path / "run", "coco", truth, predictions, statuses={10: "missing"})
    path = write_truth(tmp_path / "truth.json", truth)
    arguments = ["evaluate", str(run), "--truth", str(path), "-o", str(tmp_path / "eval")]
    assert cli.run(arguments) == 2


def test_another_evaluation_is_not_overwritten(tmp_path):
    truth = random_truth("coco", seed=1)
    predictions = random_predictions("coco", truth, seed=1)
    first = evaluate(tmp_path, "coco", truth, predictions)
    assert evaluate(tmp_path, "coco", truth, predictions) == first
    with pytest.raises(ConfigurationMismatchError, match="draws: 20 -> 30"):
        evaluate(tmp_path, "coco", truth, predictions, draws=30)
    with pytest.raises(ConfigurationMismatchError, match="input predictions"):
        evaluate(tmp_path, "coco", truth, predictions[:-1])
    evaluate(tmp_path, "coco", truth, predictions, draws=30, overwrite=True)
    (tmp_path / "eval" / "notes.txt").write_text("mine")
    with pytest.raises(ConfigurationMismatchError, match=r"notes\.txt"):
        evaluate(tmp_path, "coco", truth, predictions, draws=30, overwrite=True)
