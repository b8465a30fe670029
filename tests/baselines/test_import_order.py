"""Imported results keep their own order: official numbers are the original file's, bit for bit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from baselines.tracks import call, run_document
from evaluation.detection_runs import box_mask, random_predictions, random_truth, text_counts
from evaluation.official import direct_coco, direct_lvis

DIRECT = {
    "coco": direct_coco,
    "coco-masks": lambda truth_path, entries: direct_coco(truth_path, entries, "segm"),
    "lvis": direct_lvis,
}


def write_json(path: Path, document) -> Path:
    path.write_text(json.dumps(document))
    return path


def track_of(folder: Path, truth, name="track.json") -> Path:
    images = [{k: i[k] for k in ("id", "file_name", "width", "height")} for i in truth["images"]]
    document = {"info": {}, "images": images, "categories": truth["categories"]}
    return write_json(folder / name, document)


def import_run(folder: Path, task, truth, entries, *options) -> Path:
    """The run that an import of these entries makes."""
    arguments = ["--task", task, "--track", track_of(folder, truth), "-o", folder / "run"]
    source = write_json(folder / "results.json", entries)
    assert call(["baseline", "import", source, *arguments, *options]) == 0
    return folder / "run"


def evaluate(run: Path, truth_path: Path, output: Path, *options):
    arguments = ["evaluate", run, "--truth", truth_path, "-o", output, "--draws", "3", *options]
    assert call(arguments) == 0
    return json.loads((output / "summary.json").read_text())


def tied_results(task, seed, **options):
    """A truth, and results of three scores in which a file's order and the canonical one differ."""
    truth = random_truth(task, seed=seed, images=8, categories=4, **options)
    for number, annotation in enumerate(truth["annotations"] if task == "coco-masks" else ()):
        annotation["iscrowd"] = int(number % 7 == 0)
    entries = random_predictions(task, truth, seed=seed, per_image=25, levels=3)
    np.random.default_rng(seed).shuffle(entries)
    return truth, entries


@pytest.mark.parametrize("task", DIRECT)
@pytest.mark.parametrize("seed", range(4))
def test_every_official_number_of_a_file_with_ties(task, seed, tmp_path):
    truth, entries = tied_results(task, seed)
    truth_path = write_json(tmp_path / "truth.json", truth)
    run = import_run(tmp_path, task, truth, entries)
    scenes = json.loads((run / "run.json").read_text())["scenes"]
    assert [one["source"] for one in scenes.values()] == [{"file": "results.json"}] * 8
    expected, _ = DIRECT[task](truth_path, entries)
    other, _ = DIRECT[task](truth_path, entries[::-1])
    assert list(expected) != list(other)  # the order decides
    official = evaluate(run, truth_path, tmp_path / "official")
    assert official["official"] == list(expected)
    fast = evaluate(run, truth_path, tmp_path / "fast", "--evaluator", "fast")
    assert fast["official"] == pytest.approx(list(expected), abs=1e-12)


def test_ties_across_categories_at_the_cap_of_lvis(tmp_path):
    """Which of 380 equal masks are among the image's 300 is the file's order, in any category."""
    truth = random_truth("lvis", seed=9, images=2, categories=5, per_image=9)
    entries = random_predictions("lvis", truth, seed=9, per_image=380, levels=2)
    np.random.default_rng(9).shuffle(entries)
    truth_path = write_json(tmp_path / "truth.json", truth)
    expected, _ = direct_lvis(truth_path, entries)
    assert list(expected) != list(direct_lvis(truth_path, entries[::-1])[0])
    summary = evaluate(import_run(tmp_path, "lvis", truth, entries), truth_path, tmp_path / "eval")
    assert summary["official"] == list(expected)
    assert summary["counts"]["lost_to_cap"] == 160


def test_masks_without_a_pixel_take_places_of_the_cap_as_in_lvis(tmp_path, capfd):
    truth = random_truth("lvis", seed=10, images=2, categories=4, per_image=9)
    entries = random_predictions("lvis", truth, seed=10, per_image=290)
    for image in truth["images"]:
        no_pixel = text_counts(box_mask([0, 0, 0, 0]))
        empty = {"image_id": image["id"], "category_id": 5, "segmentation": no_pixel, "score": 0.99}
        entries += [dict(empty) for _ in range(60)]
    truth_path = write_json(tmp_path / "truth.json", truth)
    run = import_run(tmp_path, "lvis", truth, entries)
    expected, _ = direct_lvis(truth_path, entries)
    with_pixels = [e for e in entries if e["score"] != 0.99]
    assert list(expected) != list(direct_lvis(truth_path, with_pixels)[0])
    summary = evaluate(run, truth_path, tmp_path / "eval")
    assert summary["official"] == list(expected)
    assert json.loads((run / "summary.json").read_text())["empty_masks_dropped"] == 0
    assert run_document(run)["configuration"]["imported"]["empty_masks_dropped"] == 120
    assert "100 masks lost to the cap beside masks without a pixel" in capfd.readouterr().err


@pytest.mark.parametrize("task", DIRECT)
def test_the_order_survives_a_merge_and_another_division_into_files(task, tmp_path):
    truth, entries = tied_results(task, 5)
    truth_path = write_json(tmp_path / "truth.json", truth)
    run = import_run(tmp_path, task, truth, entries)
    divided = tmp_path / "divided"
    assert call(["merge", run, "-o", divided, "--images-per-file", "3"]) == 0
    expected, _ = DIRECT[task](truth_path, entries)
    assert evaluate(divided, truth_path, tmp_path / "eval")["official"] == list(expected)


def test_the_order_survives_a_subset(tmp_path):
    truth, entries = tied_results("coco", 6)
    kept = {i["id"] for i in truth["images"][::2]}
    part = {**truth, "images": [i for i in truth["images"] if i["id"] in kept]}
    part["annotations"] = [a for a in truth["annotations"] if a["image_id"] in kept]
    truth_path = write_json(tmp_path / "truth.json", truth)
    run = import_run(tmp_path, "coco", part, entries, "--subset")
    expected, _ = direct_coco(
        write_json(tmp_path / "part.json", part), [e for e in entries if e["image_id"] in kept]
    )
    assert evaluate(run, truth_path, tmp_path / "eval")["official"] == list(expected)


def test_equal_confidence_is_canonical_whatever_the_order_of_the_file(tmp_path):
    """A file that lists its best boxes first must not keep its ranking when that is taken away."""
    truth, entries = tied_results("coco", 7)
    best_first = sorted(entries, key=lambda e: -e["score"])
    summaries = []
    for name, found in (("best", best_first), ("worst", best_first[::-1])):
        (tmp_path / name).mkdir()
        truth_path = write_json(tmp_path / name / "truth.json", truth)
        run = import_run(tmp_path / name, "coco", truth, found)
        output = tmp_path / name / "eval"
        summaries.append(evaluate(run, truth_path, output))
        assert call(["evidence", "verify", output]) == 0
    best, worst = summaries
    assert best["official"] != worst["official"]
    assert best["equal_confidence"] == worst["equal_confidence"]
    assert best["matched"] == worst["matched"]


def test_equal_scores_of_a_file_are_its_own_policy_and_the_canonical_one_stands_beside(tmp_path):
    truth = random_truth("coco", seed=8, images=8, categories=3)
    entries = random_predictions("coco", truth, seed=8, per_image=20, levels=1)
    truth_path = write_json(tmp_path / "truth.json", truth)
    summary = evaluate(import_run(tmp_path, "coco", truth, entries), truth_path, tmp_path / "eval")
    assert summary["official"] == list(direct_coco(truth_path, entries)[0])
    assert not summary["equal_confidence"]["already_equal"]
    assert summary["equal_confidence"]["official"] != summary["official"]
    assert call(["evidence", "verify", tmp_path / "eval"]) == 0
