"""`legoworld evaluate` as it is called: what it prints, what it writes, what it refuses."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from evaluation.depth.folders import write_arrays
from evaluation.depth.folders import write_run as write_depth_run
from evaluation.detection_runs import (
    random_predictions,
    random_truth,
    read_rows,
    write_run,
    write_truth,
)

from legoworld import cli
from legoworld.evaluation.detection.matching.matched_metrics import matched_metrics
from legoworld.evaluation.detection.matching.outcomes import counts_from, table_from
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.resampling import resampled_metrics


@pytest.fixture(params=["coco", "lvis"])
def scored(request, tmp_path, capsys):
    """(task, folder of an evaluation made by the command, what it printed)."""
    task = request.param
    truth = random_truth(task, seed=1)
    predictions = random_predictions(task, truth, seed=1)
    failed = truth["images"][2]["id"]
    left = [p for p in predictions if p["image_id"] != failed]
    run = write_run(tmp_path / "run", task, truth, left, statuses={failed: "missing"})
    path = write_truth(tmp_path / "truth.json", truth)
    out = tmp_path / "eval"
    arguments = ["evaluate", str(run), "--truth", str(path), "-o", str(out), "--draws", "50", "-v"]
    assert cli.run(arguments) == 0
    return task, out, capsys.readouterr().out


def test_the_official_lines_come_first_and_every_number_has_its_denominator(scored):
    task, folder, shown = scored
    lines = shown.splitlines()
    summary = json.loads((folder / "summary.json").read_text())
    with_truth = summary["coverage"]["with_truth"]
    assert f"12 images attempted, 11 scored, {with_truth} with truth" in lines[0]
    official = [x for x in lines if "@[ IoU=" in x]
    assert lines[2:].index(official[0]) == 0
    assert len(official) == {"coco": 12, "lvis": 13}[task]
    rows = [x for x in lines if x.startswith(("A", "class_"))]
    assert len(rows) >= 12 + 19
    nouns = ("image", "annotation", "pair", "predi", "categor")
    assert all(any(noun in row for noun in nouns) for row in rows)
    assert "1 missing, 11 ok" in shown
    if task == "lvis":
        assert "APr: " in shown


def test_a_few_lines_hold_what_is_asked_for_first(scored, tmp_path, capsys):
    _, folder, _ = scored
    summary = json.loads((folder / "summary.json").read_text())
    arguments = ["evaluate", str(tmp_path / "run"), "--truth", str(tmp_path / "truth.json")]
    assert cli.run([*arguments, "-o", str(folder), "--draws", "50"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 6
    with_truth = summary["coverage"]["with_truth"]
    assert f"12 images attempted, 11 scored, {with_truth} with truth" in lines[0]
    ap, interval = summary["metrics"]["AP"], summary["intervals"]["AP"]
    assert lines[1].startswith(f"AP {ap:.4f} [{interval['low']:.4f}, {interval['high']:.4f}], AP50")
    assert f"{summary['counts']['truth_instances']} annotations" in lines[1]
    assert lines[-2] == f"-> {folder}"
    assert lines[-1].startswith("look at it: legoworld report ")


def test_the_json_form(scored, tmp_path, capsys):
    task, folder, _ = scored
    summary = json.loads((folder / "summary.json").read_text())
    arguments = ["evaluate", str(tmp_path / "run"), "--truth", str(tmp_path / "truth.json")]
    assert cli.run([*arguments, "-o", str(folder), "--draws", "50", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["summary"] == summary
    assert document["schema_version"] == 1
    assert summary["task"] == task
    assert set(summary["intervals"]) >= set(summary["metrics"])
    assert all(x["unit"] == "image" for x in summary["intervals"].values())


def test_rows_add_up_to_the_summary(scored):
    _, folder, _ = scored
    summary = json.loads((folder / "summary.json").read_text())
    images = read_rows(folder / "per_image.jsonl")
    categories = read_rows(folder / "per_category.jsonl")
    counts = summary["counts"]
    assert sum(r["n_truth"] for r in images) == counts["truth_instances"]
    assert sum(r["n_truth"] for r in categories) == counts["truth_instances"]
    assert sum(r["n_predictions"] for r in images) == counts["predictions"]
    assert sum(r["n_unverified"] for r in images) == counts["unverified_dropped"]
    for kind in ("class_aware", "class_agnostic"):
        found = summary["matched"][kind]
        for name in ("n_gt", "n_dt", "n_matched"):
            assert sum(r[kind][name] for r in images) == found[name]
        total = sum(r[kind]["iou_sum"] for r in images)
        assert found["miou_gt_micro"] == pytest.approx(total / found["n_gt"])
    defined = [r["AP"] for r in categories if r["AP"] is not None]
    assert summary["metrics"]["AP"] == pytest.approx(np.mean(defined), abs=1e-12)
    assert counts["categories_with_truth"] == len(defined)
    for name in ("tp", "fp", "ignored"):
        assert sum(r["greedy_50"][name] for r in images) == sum(
            r["greedy_50"][name] for r in categories
        )


def test_the_view_says_what_became_of_every_prediction(scored):
    _, folder, _ = scored
    images = read_rows(folder / "per_image.jsonl")
    predictions = json.loads((folder / "view" / "predictions.json").read_text())
    truth = json.loads((folder / "view" / "truth.json").read_text())
    for name in ("tp", "fp", "ignored", "unverified"):
        key = {"unverified": "n_unverified"}.get(name)
        expected = sum(r[key] if key else r["greedy_50"][name] for r in images)
        assert sum(p["outcome_50"] == name for p in predictions) == expected
    by_number = {a["id"]: a for a in truth["annotations"]}
    paired = [p for p in predictions if p["pair_annotation"]]
    assert paired
    for p in paired:
        true = by_number[p["pair_annotation"]]
        assert (p["image_id"], p["category_id"]) == (true["image_id"], true["category_id"])
        assert 0 < p["pair_iou"] <= 1


def test_matches_answer_for_any_selection_of_images(scored):
    """What a comparison over paired images needs: weights 0 and 1 on the stored matches."""
    task, folder, _ = scored
    protocol = detection_protocol(task)
    summary = json.loads((folder / "summary.json").read_text())
    truth = json.loads((folder / "view" / "truth.json").read_text())
    with np.load(folder / "matches.npz") as stored:
        arrays = dict(stored)
    assert {name for name in arrays if name.endswith("state")} == {"state", "equal_state"}
    letters = {c["id"]: c.get("frequency", "") for c in truth["categories"]}
    frequencies = np.array([letters[int(i)] for i in arrays["category_ids"]])
    whole = np.ones((1, 12), np.int32)
    for policy, metrics in (
        ("", summary["metrics"]),
        ("equal_", summary["equal_confidence"]["metrics"]),
    ):
        found = resampled_metrics(table_from(arrays, policy), protocol, whole, frequencies)
        for name, value in metrics.items():
            if value is None:
                assert np.isnan(found[name][0])
            else:
                assert found[name][0] == pytest.approx(value, abs=1e-12)
    images = read_rows(folder / "per_image.jsonl")
    some = np.array([[i % 2 for i in range(12)]], np.int32)
    counts = counts_from(arrays, class_aware=True)
    half = matched_metrics(counts, some)
    chosen = [r["class_aware"] for r in images[1::2]]
    expected = sum(r["iou_sum"] for r in chosen) / sum(r["n_gt"] for r in chosen)
    assert half["miou_gt_micro"][0] == pytest.approx(expected)


def test_depth_goes_to_its_own_evaluator(tmp_path, capsys):
    z = {f"{n}.png": np.random.default_rng(k).uniform(1, 9, (30, 40)) for k, n in enumerate("ab")}
    run = write_depth_run(tmp_path / "run", {**z, "c.png": "missing"})
    truth = write_arrays(tmp_path / "truth", {**z, "c.png": z["a.png"]})
    out = tmp_path / "eval"
    arguments = ["evaluate", str(run), "--truth", str(truth), "-o", str(out), "--draws", "20"]
    assert cli.run(arguments) == 0
    shown = capsys.readouterr().out
    assert "3 images attempted, 2 scored" in shown
    assert "abs_rel" in shown
    assert "missing: c.png" in shown
    assert cli.run(["evidence", "verify", str(out)]) == 0
    assert cli.run([*arguments, "--evaluator", "fast"]) == 2


def test_options_of_the_other_kind_are_refused(tmp_path):
    truth = random_truth("coco", seed=1)
    run = write_run(tmp_path / "run", "coco", truth, [])
    path = write_truth(tmp_path / "truth.json", truth)
    arguments = ["evaluate", str(run), "--truth", str(path), "-o", str(tmp_path / "eval")]
    assert cli.run([*arguments, "--camera-model", "dataset"]) == 2
    assert cli.run([*arguments, "--draws", "0"]) == 2


def test_scoring_boxes_starts_neither_blender_nor_a_kernel_nor_another_family(tmp_path):
    truth = random_truth("coco", seed=1)
    run = write_run(tmp_path / "run", "coco", truth, random_predictions("coco", truth, seed=1))
    path = write_truth(tmp_path / "truth.json", truth)
    program = (
        "import sys; from legoworld.cli import run;"
        f"assert run(['evaluate', {str(run)!r}, '--truth', {str(path)!r},"
        f" '-o', {str(tmp_path / 'eval')!r}, '--draws', '5']) == 0;"
        "bad = {'bpy', 'torch', 'cv2', 'matplotlib', 'legoworld.visibility.kernel',"
        " 'legoworld.scene.blender_process'} & set(sys.modules);"
        "rooms = {m for m in sys.modules if m.startswith('legoworld.') and '.records.' not in m};"
        "bad |= {m for m in rooms if any(w in m for w in ('bench', 'depth', 'reconstruction'))};"
        "assert not bad, bad"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
