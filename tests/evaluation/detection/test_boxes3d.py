"""AP3D: Omni3D's rules, from a truth file and a run to the numbers."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from evaluation.commands import evaluate
from evaluation.detection_runs import checked, match_everything, write_run, write_truth
from evaluation.solids import about_y, ap3d, box, rotation

from legoworld import cli
from legoworld.errors import LegoWorldError
from legoworld.evaluation.box_overlaps import box_ious
from legoworld.evaluation.detection.box3d_errors import difference_said
from legoworld.evaluation.detection.evaluators import run_evaluator
from legoworld.evaluation.detection.grid import SPACE
from legoworld.evaluation.detection.inputs.prediction_checks import PredictionsInvalidError
from legoworld.evaluation.detection.inputs.truth_checks import TruthInvalidError
from legoworld.evaluation.detection.payloads.boxes3d import _document
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.accumulation import accumulate, metric_value
from legoworld.evaluation.detection.scoring import ScoreRequest, score

K = [[100.0, 0.0, 50.0], [0.0, 100.0, 50.0], [0.0, 0.0, 1.0]]
NAMES = ("cup", "chair")


def annotation(number, corners, image=1, category=1, **more):
    return {
        "id": number,
        "image_id": image,
        "category_id": category,
        "valid3D": True,
        "bbox3D_cam": np.asarray(corners).tolist(),
        "dimensions": [1, 1, 1],
        "truncation": 0.0,
        "visibility": 1.0,
        **more,
    }


def truth_of(*annotations, images=1):
    return {
        "images": [
            {"id": i + 1, "file_path": f"x/{i}.jpg", "file_name": f"{i}.jpg",
             "width": 100, "height": 100, "K": K}
            for i in range(images)
        ],
        "annotations": list(annotations),
        "categories": [{"id": k + 1, "name": name} for k, name in enumerate(NAMES)],
    }  # fmt: skip


def result(corners, image=1, category=1, score=1.0):
    return {
        "image_id": image,
        "category_id": category,
        "score": score,
        "bbox3D": np.asarray(corners).tolist(),
    }


def metrics_of(folder, truth, results):
    protocol, read, predictions = checked(folder, "boxes3d", truth, results)
    _, table = match_everything(protocol, read, predictions)
    curves = accumulate(table, protocol)
    official = run_evaluator(read, predictions, protocol, "official")
    ours = [metric_value(m, curves) for m in protocol.metrics]
    assert np.abs(np.array(ours) - official.official).max() <= 1e-15
    assert np.array_equal(curves.precision, official.precision)
    return dict(zip([m.name for m in protocol.metrics], official.official, strict=True)), curves


def test_two_truths_and_one_detection_of_a_third(tmp_path):
    """IoU 1/3: six of ten thresholds, at half of the recalls."""
    truth = truth_of(annotation(1, box((0, 0, 5))), annotation(2, box((4, 0, 5))))
    found, _ = metrics_of(tmp_path, truth, [result(box((0.5, 0, 5)))])
    assert found["AP"] == pytest.approx(6 / 10 * 51 / 101, abs=1e-12)
    assert round(found["AP"], 6) == 0.302970
    assert found["AP15"] == found["AP25"] == pytest.approx(51 / 101, abs=1e-12)
    assert found["AP50"] == 0
    assert found["APn"] == found["AP"]
    assert found["APm"] == found["APf"] == -1
    assert found["AR1"] == found["AR100"] == pytest.approx(0.3, abs=1e-12)


def random_case(seed):
    """Boxes of one category in six images, moved; some truths ignored, some far away."""
    random = np.random.default_rng(seed)
    truths, results = [], []
    for image in range(1, 7):
        for _ in range(random.integers(0, 7)):
            z = random.choice([3.0, 9.9, 20.0, 50.0])
            size, turn = random.uniform(0.5, 2, 3), rotation(random)
            center = np.array([random.normal() * 2, random.normal(), z])
            cut = float(random.choice([0.0, 0.0, 0.5]))
            truths.append(annotation(len(truths) + 1, box(center, size, turn), image,
                                     truncation=cut))  # fmt: skip
            for _ in range(random.integers(0, 3)):
                moved = center + random.normal(size=3) * 0.25 * size
                results.append(result(box(moved, size * random.uniform(0.8, 1.2), turn), image))
        depths = random.choice([4.0, 40.0], random.integers(0, 3))
        results += [result(box((0, 0, z)), image) for z in depths]
    order = random.permutation(len(results))
    for k, rank in enumerate(order):
        results[k]["score"] = float(rank + 1) / 1000
    return truths, results


@pytest.mark.parametrize("seed", range(6))
def test_every_number_is_bit_for_bit_that_of_plain_python(seed, tmp_path):
    truths, results = random_case(seed)
    found, curves = metrics_of(tmp_path, truth_of(*truths, images=6), results)
    ious = box_ious([r["bbox3D"] for r in results], [t["bbox3D_cam"] for t in truths])
    rows = [(t["image_id"], np.mean(t["bbox3D_cam"], 0)[2], t["truncation"] >= 1 / 3)
            for t in truths]  # fmt: skip
    mine = [(r["image_id"], np.mean(r["bbox3D"], 0)[2], r["score"]) for r in results]
    for a, (name, depths) in enumerate(zip(SPACE.areas, SPACE.ranges, strict=True)):
        expected = ap3d(rows, mine, lambda d, t: ious[d, t], SPACE.iou, depths)
        if not expected["n"]:
            assert (curves.precision[:, :, 0, a] == -1).all()
            continue
        assert np.array_equal(curves.precision[:, :, 0, a], expected["precision"])
        assert np.array_equal(curves.recall[:, 0, a, -1], expected["recall"])
        suffix = "" if name == "all" else name[0]
        assert found[f"AP{suffix}"] == expected["precision"].mean()


@pytest.mark.parametrize(
    ("more", "ignored"),
    [
        ({}, False),
        ({"truncation": 1 / 3}, True),
        ({"truncation": 0.33}, False),
        ({"visibility": 1 / 3}, True),
        ({"visibility": 0.34}, False),
        ({"truncation": -1, "visibility": -1}, False),
        ({"truncation": None, "visibility": None}, False),
        ({"valid3D": False}, True),
        ({"dimensions": [1, 0, 1]}, True),
        ({"bbox3D_cam": box((0, 0, 0.4)).tolist()}, True),  # a corner behind the camera
        ({"bbox3D_cam": [[-1.0] * 3] * 8}, True),  # Omni3D's word for none
    ],
)
def test_which_truth_is_ignored(more, ignored, tmp_path):
    other = annotation(2, box((3, 0, 5)))
    truth = truth_of({**annotation(1, box((0, 0, 5))), **more}, other)
    _, read, _ = checked(tmp_path, "boxes3d", truth, [])
    assert [a["ignore"] for a in read.annotations] == [int(ignored), 0]
    found, _ = metrics_of(tmp_path / "again", truth, [result(box((3, 0, 5)))])
    assert found["AP"] == pytest.approx(1.0 if ignored else 51 / 101)


def test_an_ignored_truth_takes_one_detection_and_no_other(tmp_path):
    truth = truth_of(annotation(1, box((0, 0, 5)), visibility=0.1), annotation(2, box((3, 0, 5))))
    twice = [result(box((0, 0, 5)), score=0.9), result(box((0, 0, 5)), score=0.8)]
    found, _ = metrics_of(tmp_path, truth, [*twice, result(box((3, 0, 5)), score=0.7)])
    assert found["AP"] == pytest.approx(0.5)  # the second is a false positive above the true one


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda b: b * [1, -1, -1], "behind the camera.*negate y and z"),
        (lambda b: b * 1000, "a median depth of .*millimetres"),
        (lambda b: b[[1, 0, 2, 3, 4, 5, 6, 7]], "corners that are not a box's"),
        (lambda b: b * math.nan, "corners that are not a box's"),
    ],
)
def test_other_frames_units_and_orders_are_refused_with_advice(change, said, tmp_path):
    boxes = [box((x, 0, 4)) for x in (-3, -1, 1, 3)]
    truth = truth_of(*(annotation(k + 1, b) for k, b in enumerate(boxes)))
    results = [result(change(b)) for b in boxes]
    with pytest.raises(PredictionsInvalidError, match=said):
        checked(tmp_path, "boxes3d", truth, results, prediction_order="given")
    if "behind" in said:
        moved = [annotation(k + 1, change(b)) for k, b in enumerate(boxes)]
        with pytest.raises(TruthInvalidError, match=said):
            checked(tmp_path / "truth", "boxes3d", truth_of(*moved), [])


def test_a_scene_of_far_things_is_scored_and_a_far_truth_is_doubted(tmp_path):
    far = [box((x, 0, 4000)) for x in (-3, -1, 1, 3)]
    truth = truth_of(*(annotation(k + 1, b) for k, b in enumerate(far)))
    _, read, predictions = checked(tmp_path, "boxes3d", truth, [result(b) for b in far])
    assert read.warnings == ("4 truth boxes at a median depth of 4000 m; are they in metres?",)
    assert len(predictions.entries) == 4


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t["annotations"][0].pop("bbox3D_cam"), "no corners.*8 corners x, y, z"),
        (lambda t: t["annotations"][0].update(bbox3D_cam=[[0, 0]] * 8), "no corners"),
        (lambda t: t["images"][0].pop("K"), "K None.*3 rows of 3 numbers"),
        (lambda t: t["images"][0].update(K=[[1, 2], [3, 4]]), "K .*3 rows of 3 numbers"),
    ],
)
def test_a_broken_truth_is_refused(change, said, tmp_path):
    truth = truth_of(annotation(1, box((0, 0, 5))))
    change(truth)
    with pytest.raises(TruthInvalidError, match=said):
        checked(tmp_path, "boxes3d", truth, [])


def test_flat_boxes_are_counted_and_overlap_nothing(tmp_path):
    flat = box((0, 0, 5), (1, 1, 0))
    truth = truth_of(annotation(1, flat), annotation(2, box((3, 0, 5))))
    protocol, read, predictions = checked(tmp_path, "boxes3d", truth, [result(flat)])
    assert read.warnings == ("1 truth boxes without a volume: they are ignored",)
    assert predictions.warnings == ("1 boxes without a volume: they overlap nothing",)
    made = score(
        ScoreRequest(truth=read, protocol=protocol, kind="official", draws=5, seed=0),
        predictions,
        lambda _text: None,
    )
    assert made.scores.official[0] == 0


def made(folder, results):
    truth = truth_of(
        annotation(1, box((0, 0, 5), (1, 2, 1), about_y(30))),
        annotation(2, box((1, 0, 15)), image=2, category=2),
        annotation(3, box((1, 0, 15)), image=3, category=2, truncation=0.5),
        images=3,
    )
    own = [{**result(a["bbox3D_cam"], a["image_id"], a["category_id"])}
           for a in truth["annotations"]]  # fmt: skip
    run = write_run(folder / "run", "boxes3d", truth, results(own))
    return run, write_truth(folder / "truth.json", truth)


def test_a_truth_as_its_own_prediction_scores_one_in_any_order(tmp_path):
    run, truth = made(tmp_path / "a", lambda own: own)
    assert evaluate(run, truth, tmp_path / "eval") == 0
    summary = json.loads((tmp_path / "eval" / "summary.json").read_text())
    shown = [summary["metrics"][m] for m in ("AP", "AP50", "APn", "APm", "AR1")]
    assert shown == pytest.approx([1.0] * 5, abs=1e-15)
    assert summary["iou_type"] == "bbox3D"
    assert summary["matched"]["class_aware"]["miou_gt_micro"] == pytest.approx(1)
    run, truth = made(tmp_path / "b", lambda own: own[::-1])
    assert evaluate(run, truth, tmp_path / "again") == 0
    names = ("summary.json", "per_image.jsonl", "per_category.jsonl", "view/predictions.json")
    for name in names:
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "eval" / name).read_bytes()
    assert cli.run(["evidence", "verify", str(tmp_path / "eval"), "-q"]) == 0


def test_hotcoco_is_refused_in_a_sentence(tmp_path, capsys):
    run, truth = made(tmp_path, lambda own: own)
    assert evaluate(run, truth, tmp_path / "eval", "--evaluator", "fast") == 2
    assert "hotcoco does not score boxes in space" in capsys.readouterr().err


def test_the_card_says_what_is_computed():
    protocol = detection_protocol("boxes3d")
    card = protocol.card
    assert card.value("scoring.iou_thresholds") == pytest.approx(SPACE.iou)
    assert card.value("scoring.depth_ranges_m") == [list(r) for r in SPACE.ranges]


def test_pairs_are_said_before_they_are_compared_and_bounded(tmp_path):
    truth = truth_of(*(annotation(k, box((3 * k, 0, 5))) for k in range(1, 4)))
    results = [result(box((3 * k, 0, 5))) for k in range(1, 4)]
    protocol, read, predictions = checked(tmp_path, "boxes3d", truth, results)

    def scored(most):
        said = []
        bounded = replace(protocol, payload=replace(protocol.payload, most_pairs=most))
        request = ScoreRequest(truth=read, protocol=bounded, kind="official", draws=2, seed=0)
        score(request, predictions, said.append)
        return said

    assert scored(9)[0] == "matching 9 pairs"
    with pytest.raises(LegoWorldError, match=r"image 1 has too many boxes.*9 pairs.*at most 8"):
        scored(8)


def test_place_size_and_yaw_beside_the_overlap(tmp_path):
    """A yaw of 100 degrees with length and width exchanged is one of 10 degrees."""
    true = box((0, 0, 5), (2, 1, 1))
    moved = box((0.3, 0, 5.4), (1, 1, 2), about_y(100))
    run = write_run(tmp_path / "run", "boxes3d", truth_of(annotation(1, true)), [result(moved)])
    truth = write_truth(tmp_path / "truth.json", truth_of(annotation(1, true)))
    assert evaluate(run, truth, tmp_path / "eval") == 0
    found = json.loads((tmp_path / "eval" / "summary.json").read_text())["in_space"]
    assert found == {
        "pairs": 1,
        "center_m": pytest.approx(0.5),
        "volume_ratio": pytest.approx(1),
        "yaw_mod_90_deg": pytest.approx(10),
    }
    said = difference_said(moved, true)
    assert said == (
        "its centre is 0.30 m right, 0.00 m up, 0.40 m farther; "
        "size 1.00 x 1.00 x 1.00 of the true one; turned 10 deg"
    )


def test_a_true_box_has_its_extent_in_the_picture_and_its_depth():
    """A cube of one metre, 5 to 6 m away: 100 px of focal length over the near face's depth."""
    corners = box((0.0, 0.0, 5.5), (1.0, 1.0, 1.0))
    (made,) = _document(truth_of(annotation(1, corners)), "truth.json")["annotations"]
    assert made["bbox"] == pytest.approx([40, 40, 20, 20])
    assert (made["area"], made["iscrowd"]) == (pytest.approx(5.5), 0)
    for change in ({"K": K[:2]}, {"width": None}, {"height": math.inf}):
        truth = truth_of(annotation(1, corners))
        truth["images"][0].update(change)
        (made,) = _document(truth, "truth.json")["annotations"]
        assert made["bbox"] == [0.0] * 4, change
