"""Amodal masks: COCOeval's AP, also by occlusion, and the numbers that AP hides."""

from __future__ import annotations

import contextlib
import io
import json

import numpy as np
import pytest
from evaluation.amodal_runs import annotation, decoded, encoded, random_stacks, stacked, star
from evaluation.detection_runs import (
    checked,
    evaluate_detections,
    read_rows,
    write_run,
    write_truth,
)
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from legoworld.api.coco_export import export
from legoworld.cli import run as call
from legoworld.evaluation.detection.amodal_scores import occlusion_level
from legoworld.evaluation.detection.inputs.prediction_checks import PredictionsInvalidError
from legoworld.evaluation.detection.inputs.truth_checks import TruthInvalidError
from legoworld.evaluation.detection.text import short_detections
from legoworld.evaluation.family import evaluation_text


class LevelEval(COCOeval):
    """COCOeval that ignores the truths of other levels."""

    def __init__(self, truth, results, level):
        super().__init__(truth, results, "segm")
        self._level = level

    def _prepare(self):
        super()._prepare()
        for truths in self._gts.values():
            for one in truths:
                one["ignore"] = one["ignore"] or one["level"] != self._level


def official(truth, predictions, level=None):
    with contextlib.redirect_stdout(io.StringIO()):
        true = COCO()
        true.dataset = json.loads(json.dumps(truth))
        for one in true.dataset["annotations"]:
            one["level"] = occlusion_level(int(decoded(one["segmentation"]).sum()),
                                    int(decoded(one["visible_mask"]).sum()))  # fmt: skip
        true.createIndex()
        found = true.loadRes(json.loads(json.dumps(predictions)))
        evaluation = LevelEval(true, found, level) if level else COCOeval(true, found, "segm")
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return evaluation.stats.tolist()


def scored(folder, truth, predictions, **options):
    run = write_run(folder / "run", "amodal", truth, predictions)
    file = write_truth(folder / "truth.json", truth)
    made = evaluate_detections(run, file, folder / "eval", draws=20, **options)
    return made, read_rows(folder / "eval" / "per_image.jsonl")


@pytest.mark.parametrize("seed", range(3))
def test_every_ap_is_that_of_cocoeval_bit_for_bit(seed, tmp_path):
    truth, predictions = random_stacks(seed)
    summary, _ = scored(tmp_path, truth, predictions)
    assert list(summary.official) == official(truth, predictions)
    for level, scores in summary.amodal.levels.items():
        stats = official(truth, predictions, level)
        names = {"AP": stats[0], "AP50": stats[1], "AP75": stats[2], "AR100": stats[8]}
        assert scores.metrics == {k: None if v == -1 else v for k, v in names.items()}
    counted = sum(scores.truth_instances for scores in summary.amodal.levels.values())
    assert counted == sum(not a["iscrowd"] for a in truth["annotations"])


def test_the_bounds_of_occlusion_are_inclusive():
    assert [occlusion_level(100, v) for v in (100, 99, 75, 74, 0)] == [
        "none", "partial", "partial", "heavy", "heavy"
    ]  # fmt: skip


def in_front(masks):
    """Ordered pairs by brute force; masks: (amodal, visible) arrays."""
    pixels = {
        (i, j): int((v & b).sum())
        for i, (_, v) in enumerate(masks)
        for j, (b, _) in enumerate(masks)
        if i != j
    }
    return {pair for pair, count in pixels.items() if count > pixels[pair[::-1]]}


@pytest.mark.parametrize("seed", range(3))
def test_sums_of_an_image_are_those_of_its_pixels(seed, tmp_path):
    truth, predictions = random_stacks(seed, images=9)
    summary, rows = scored(tmp_path, truth, predictions)
    view = json.loads((tmp_path / "eval" / "view" / "predictions.json").read_text())
    for image, row in zip(truth["images"], rows, strict=True):
        mine = [(k, a) for k, a in enumerate(truth["annotations"], 1)
                if a["image_id"] == image["id"] and not a["iscrowd"]]  # fmt: skip
        true = [(decoded(a["segmentation"]), decoded(a["visible_mask"])) for _, a in mine]
        place = {k: t for t, (k, _) in enumerate(mine)}
        pairs = {place[p["pair_annotation"]]: p for p in view if p["image_id"] == image["id"]
                 and p["pair_annotation"] in place and p["pair_iou"] >= 0.5}  # fmt: skip
        sums, error, invisible = row["amodal"], 0.0, 0.0
        for t, p in pairs.items():
            (a, v), (b, w) = true[t], (decoded(p["segmentation"]), decoded(p["visible_mask"]))
            error += abs(v.sum() / a.sum() - w.sum() / b.sum())
            if (a & ~v).any():
                hidden, other = a & ~v, b & ~w
                invisible += (hidden & other).sum() / (hidden | other).sum()
        assert sums["fraction_error_sum"] == pytest.approx(error, abs=1e-12)
        assert sums["invisible_iou_sum"] == pytest.approx(invisible, abs=1e-12)
        assert sums["n_matched"] == len(pairs)
        assert sums["n_occluded"] == sum((a & ~v).any() for a, v in true)
        assert sums["n_occluded_matched"] == sum((true[t][0] & ~true[t][1]).any() for t in pairs)
        assert sums["n_hidden"] == sum(not v.any() for _, v in true)
        assert sums["n_hidden_matched"] == sum(not true[t][1].any() for t in pairs)
        keys = list(pairs)
        drawn = [(decoded(p["segmentation"]), decoded(p["visible_mask"])) for p in pairs.values()]
        order = {(keys[i], keys[j]) for i, j in in_front(drawn)}
        assert sums["n_order_truth"] == len(in_front(true))
        assert sums["n_order_predicted"] == len(order)
        assert sums["n_order_right"] == len(order & in_front(true))
    total = {key: sum(row["amodal"][key] for row in rows) for key in rows[0]["amodal"]}
    assert total["n_order_truth"] > 5
    metrics = summary.amodal.metrics
    assert metrics["order_recall"] == total["n_order_right"] / total["n_order_truth"]
    assert metrics["hidden_recall"] == total["n_hidden_matched"] / total["n_hidden"]
    invisible = total["invisible_iou_sum"] / total["n_occluded"]
    assert metrics["invisible_iou"] == pytest.approx(invisible)
    assert summary.intervals["amodal.order_f1"].low <= metrics["order_f1"]


def own_answer(truth):
    keys = ("image_id", "category_id", "segmentation", "visible_mask")
    return [{**{k: a[k] for k in keys}, "score": 1.0} for a in truth["annotations"]]


def without_crowds(truth):
    return {**truth, "annotations": [{**a, "iscrowd": 0} for a in truth["annotations"]]}


def test_the_truth_as_an_answer_is_right_in_everything_and_the_controls_are_not(tmp_path):
    truth = without_crowds(random_stacks(5)[0])
    answer = own_answer(truth)
    summary, _ = scored(tmp_path, truth, answer)
    assert summary.metrics["AP"] == 1
    expected = dict.fromkeys(summary.amodal.metrics, 1.0) | {"visible_fraction_error": 0.0}
    assert summary.amodal.metrics == expected
    for name, control in summary.amodal.controls.items():
        assert control["AP"] < 0.9
        assert control["invisible_iou"] < 0.6
        assert control["hidden_recall"] == 0
        assert control["visible_fraction_error"] > 0.02
        assert name in ("visible_mask", "convex_hull")
    assert summary.amodal.controls["visible_mask"]["invisible_iou"] == 0
    again, _ = scored(tmp_path / "shuffled", truth, answer[::-1])
    assert again == summary


def test_controls_are_scored_as_if_they_had_been_submitted(tmp_path):
    truth, predictions = random_stacks(2)
    summary, _ = scored(tmp_path, truth, predictions)
    flat = [{**p, "segmentation": p["visible_mask"]} for p in predictions]
    submitted, _ = scored(tmp_path / "flat", truth, flat)
    control = summary.amodal.controls["visible_mask"]
    assert control["AP"] == pytest.approx(submitted.metrics["AP"], abs=1e-12)
    assert control["order_f1"] == submitted.amodal.metrics["order_f1"]


def test_a_hull_is_that_of_the_visible_pixels(tmp_path):
    plus = np.zeros((90, 120), bool)
    plus[40:45, 20:60] = plus[20:65, 38:42] = True
    diamond = np.abs(np.arange(90)[:, None] - 42) * 20 + np.abs(np.arange(120) - 39.5) * 22 < 470
    truth = random_stacks(0, images=1)[0]
    box = [20, 20, 40, 45]
    truth["annotations"] = [{**annotation(7, 5, diamond, plus & diamond), "id": 1, "bbox": box,
                             "area": int(diamond.sum()), "iscrowd": 0}]  # fmt: skip
    answer = [{**annotation(7, 5, plus, plus), "score": 1.0}]
    controls = scored(tmp_path, truth, answer)[0].amodal.controls
    assert controls["visible_mask"]["AP50"] == 0
    assert controls["convex_hull"]["AP50"] == pytest.approx(1)


def test_without_visible_masks_the_masks_alone_are_scored(tmp_path):
    truth, predictions = random_stacks(1)
    with_all, _ = scored(tmp_path / "all", truth, predictions)
    del predictions[3]["visible_mask"]
    summary, rows = scored(tmp_path, truth, predictions)
    assert summary.metrics == with_all.metrics
    assert summary.amodal.levels == with_all.amodal.levels
    assert summary.amodal.metrics == summary.amodal.controls == {}
    assert "amodal" not in rows[0]
    assert any("not all have a visible_mask" in w for w in summary.warnings)


def test_the_controls_are_printed_beside_every_result(tmp_path):
    truth, predictions = random_stacks(2)
    summary, _ = scored(tmp_path, truth, predictions)
    control = summary.amodal.controls["convex_hull"]["AP"]
    assert f"convex_hull {control:.4f}" in short_detections(summary)
    text = evaluation_text(summary)
    for words in ("amodal.hidden_recall", "wholly hidden annotations", "heavy", "visible_mask"):
        assert words in text
    del predictions[0]["visible_mask"]
    summary, _ = scored(tmp_path / "none", truth, predictions)
    assert "no visible masks" in short_detections(summary)
    assert "heavy" in evaluation_text(summary)
    assert "convex_hull" not in evaluation_text(summary)


def kins(truth):
    made = json.loads(json.dumps(truth))
    for one in made["annotations"]:
        one["inmodal_seg"] = one.pop("visible_mask")
    return made


def d2sa(truth):
    """What nothing hides has no visible mask."""
    made = json.loads(json.dumps(truth))
    for one in made["annotations"]:
        if one["visible_mask"] == one["segmentation"]:
            del one["visible_mask"]
            one["occlude_rate"] = 0.0
    return made


@pytest.mark.parametrize("form", [kins, d2sa])
def test_truths_of_other_datasets_score_alike(form, tmp_path):
    truth, predictions = random_stacks(3)
    ours, rows = scored(tmp_path, truth, predictions)
    theirs, same = scored(tmp_path / "other", form(truth), predictions)
    assert theirs == ours
    assert same == rows


def test_cocoa_is_read_region_by_region(tmp_path):
    square, corners = np.zeros((90, 120), bool), [20, 10, 60, 10, 60, 50, 20, 50]
    square[10:50, 20:60] = True
    seen = square.copy()
    seen[:, 45:] = False
    regions = [
        {"segmentation": corners, "name": "a cup", "area": 1600, "isStuff": 0, "order": 2,
         "occlude_rate": 0.375, "visible_mask": encoded(seen)},
        {"segmentation": [45, 5, 80, 5, 80, 70, 45, 70], "name": "wall", "area": 2275,
         "isStuff": 1, "order": 1, "occlude_rate": 0.0},
    ]  # fmt: skip
    truth = {
        "images": [{"id": 7, "file_name": "0.jpg", "width": 120, "height": 90}],
        "annotations": [{"id": 1, "image_id": 7, "regions": regions, "depth_constraint": "1-2"}],
    }
    file = write_truth(tmp_path / "cocoa.json", truth)
    track = tmp_path / "track.json"
    assert call(["track", "make", "--task", "amodal", "--truth", str(file), "-o", str(track)]) == 0
    categories = json.loads(track.read_text())["categories"]
    assert [c["name"] for c in categories] == ["object", "stuff"]
    wall = np.zeros_like(square)
    wall[5:70, 45:80] = True
    answer = [{**annotation(7, 1, square, seen), "score": 1.0},
              {**annotation(7, 2, wall, wall), "score": 1.0}]  # fmt: skip
    run = write_run(tmp_path / "run", "amodal", {**truth, "categories": categories}, answer)
    summary = evaluate_detections(run, file, tmp_path / "eval", draws=5)
    assert summary.metrics["AP"] == pytest.approx(1)
    assert summary.amodal.metrics["order_f1"] == 1
    assert summary.amodal.levels["heavy"].truth_instances == 1
    truth["annotations"].append({**truth["annotations"][0], "id": 2})
    with pytest.raises(TruthInvalidError, match="annotated more than once"):
        evaluate_detections(run, write_truth(file, truth), tmp_path / "again", draws=5)
    truth["annotations"] = [{"id": 1, "image_id": 7, "regions": [{"segmentation": []}]}]
    with pytest.raises(TruthInvalidError, match="regions that cannot be used"):
        evaluate_detections(run, write_truth(file, truth), tmp_path / "again", draws=5)


def test_an_export_is_a_truth(tmp_path):
    truth, predictions = random_stacks(4)
    run = write_run(tmp_path / "run", "amodal", truth, predictions)
    track = {"images": truth["images"], "categories": truth["categories"], "task": "amodal"}
    file = tmp_path / "track.json"
    file.write_text(json.dumps({"schema_version": 1, **track}))
    made = export(run, tmp_path / "kins.json", track=file, format="kins")
    assert made.annotations[0].a_area >= made.annotations[0].i_area
    summary = evaluate_detections(run, tmp_path / "kins.json", tmp_path / "eval", draws=5)
    assert summary.amodal.metrics["order_f1"] == 1
    plain = export(run, tmp_path / "coco.json", track=file)
    assert "inmodal_seg" not in (tmp_path / "coco.json").read_text()
    assert len(plain.annotations) == len(made.annotations)


def test_what_is_no_amodal_truth_is_refused(tmp_path):
    truth, predictions = random_stacks(0, images=3)
    run = write_run(tmp_path / "run", "amodal", truth, predictions)

    def refusal(change):
        changed = json.loads(json.dumps(truth))
        change(changed["annotations"])
        file = write_truth(tmp_path / "truth.json", changed)
        with pytest.raises(TruthInvalidError) as error:
            evaluate_detections(run, file, tmp_path / "eval", draws=5)
        return str(error.value)

    def drop_all(annotations):
        for one in annotations:
            del one["visible_mask"]

    def drop_one(annotations):
        del annotations[0]["visible_mask"]
        annotations[0]["occlude_rate"] = 0.5

    def wrong_size(annotations):
        annotations[0]["visible_mask"]["size"] = [10, 10]

    assert "no visible_mask in any annotation" in refusal(drop_all)
    assert "visible_mask" in refusal(drop_one)
    assert "visible_mask" in refusal(wrong_size)


def test_visible_masks_that_do_not_fit_are_refused(tmp_path):
    truth, predictions = random_stacks(0, images=3)

    def refusal(mask):
        changed = [{**predictions[0], "visible_mask": mask}, *predictions[1:]]
        with pytest.raises(PredictionsInvalidError) as error:
            checked(tmp_path, "amodal", truth, changed)
        return str(error.value)

    assert "visible_mask of size" in refusal({"size": [10, 10], "counts": "T3"})
    assert "visible_mask: run lengths" in refusal({"size": [90, 120], "counts": "T3"})
    plain = {"size": [90, 120], "counts": [90 * 120]}
    *_, kept = checked(tmp_path, "amodal", truth,
                       [{**predictions[0], "visible_mask": plain}, *predictions[1:]])  # fmt: skip
    assert "" not in kept.entries.visible[:]


def test_visible_pixels_outside_of_an_amodal_mask_belong_to_it(tmp_path):
    """Masks as drawn by hand, or predicted by two heads."""
    mask = star(np.random.default_rng(1))
    shifted = np.roll(mask, 3, 1)
    truth = random_stacks(0, images=1)[0]
    truth["annotations"] = [{**annotation(7, 5, mask, mask), "id": 1, "bbox": [0, 0, 9, 9],
                             "area": int(mask.sum()), "iscrowd": 0}]  # fmt: skip
    answer = [{**annotation(7, 5, mask, shifted), "score": 0.5}]
    _, (row,) = scored(tmp_path, truth, answer)
    both = (mask | shifted).sum()
    assert row["amodal"]["fraction_error_sum"] == pytest.approx(1 - mask.sum() / both)


def test_stacks_have_every_kind_of_trouble():
    truth, _ = random_stacks(0)
    areas = [(decoded(a["segmentation"]).sum(), decoded(a["visible_mask"]).sum())
             for a in truth["annotations"]]  # fmt: skip
    levels = {occlusion_level(int(a), int(v)) for a, v in areas}
    assert levels == {"none", "partial", "heavy"}
    assert any(v == 0 for _, v in areas)
    assert any(a["iscrowd"] for a in truth["annotations"])
    assert not stacked([np.ones((2, 2), bool)] * 2)[1].any()
