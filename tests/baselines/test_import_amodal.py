"""Amodal masks of others: COCO results whose visible part has KINS's name, or is a polygon."""

from __future__ import annotations

import json

from baselines.tracks import call
from evaluation.amodal_runs import random_stacks
from evaluation.detection_runs import write_run, write_truth


def write_json(path, document):
    path.write_text(json.dumps(document))
    return path


def import_entries(folder, truth, entries, name="run"):
    track = {"info": {}, "images": truth["images"], "categories": truth["categories"]}
    arguments = ["--task", "amodal", "--track", write_json(folder / "track.json", track)]
    source = write_json(folder / "results.json", entries)
    arguments += ["--category-ids", "dataset", "-o", folder / name]
    assert call(["baseline", "import", source, *arguments]) == 0
    return folder / name


def evaluate_run(run, truth_path, output):
    assert call(["evaluate", run, "--truth", truth_path, "-o", output, "--draws", "5"]) == 0
    assert call(["evidence", "verify", output]) == 0
    return json.loads((output / "summary.json").read_text())


def test_an_import_scores_as_the_results_do(tmp_path):
    truth, results = random_stacks(6)
    kins = [{**entry} for entry in results]
    for entry in kins:
        entry["inmodal_seg"] = entry.pop("visible_mask")
        entry["bbox"] = [0, 0, 1, 1]
    file = write_truth(tmp_path / "truth.json", truth)
    summary = evaluate_run(import_entries(tmp_path, truth, kins), file, tmp_path / "eval")
    own = evaluate_run(
        write_run(tmp_path / "own", "amodal", truth, results), file, tmp_path / "again"
    )
    for key in ("official", "amodal", "matched"):
        assert summary[key] == own[key]
    kept = json.loads((tmp_path / "run" / "predictions.json").read_text())
    assert all("visible_mask" in entry and "bbox" not in entry for entry in kept)


def test_polygons_of_both_masks_are_filled(tmp_path):
    truth, _ = random_stacks(6, images=1)
    entry = {"image_id": 7, "category_id": 5, "score": 0.5,
             "segmentation": [[10, 10, 50, 10, 50, 50, 10, 50]],
             "visible_mask": [[10, 10, 30, 10, 30, 50, 10, 50]]}  # fmt: skip
    run = import_entries(tmp_path, truth, [entry])
    summary = evaluate_run(run, write_truth(tmp_path / "truth.json", truth), tmp_path / "eval")
    assert summary["amodal"]["controls"].keys() == {"visible_mask", "convex_hull"}


def test_a_comparison_tells_what_ap_hides(tmp_path, capsys):
    truth, results = random_stacks(6)
    file = write_truth(tmp_path / "truth.json", truth)
    scene = write_run(tmp_path / "scene", "amodal", truth, [
        {k: a[k] for k in ("image_id", "category_id", "segmentation", "visible_mask")}
        | {"score": 1.0} for a in truth["annotations"]])  # fmt: skip
    flat = [{**entry, "segmentation": entry["visible_mask"]} for entry in results]
    evaluate_run(scene, file, tmp_path / "a")
    evaluate_run(import_entries(tmp_path, truth, flat), file, tmp_path / "b")
    arguments = ["compare", tmp_path / "a", tmp_path / "b", "-o", tmp_path / "c", "--draws", "50"]
    assert call(arguments) == 0
    capsys.readouterr()
    rows = json.loads((tmp_path / "c" / "comparison.json").read_text())["pairs"][0]["rows"]
    by_id = {row["metric"]: row for row in rows if row["images"] == "paired"}
    assert by_id["amodal.invisible_iou"]["scene"]["value"] == 1
    assert by_id["amodal.invisible_iou"]["baseline"]["value"] == 0
    assert by_id["amodal.order_f1"]["better"] == "higher"
    assert by_id["amodal.visible_fraction_error"]["better"] == "lower"
    assert by_id["amodal.visible_fraction_error"]["difference"]["value"] < 0
