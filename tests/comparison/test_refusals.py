"""What must not stand in one table is refused, and the difference is named."""

from __future__ import annotations

import json

import numpy as np
import pytest
from comparison.evaluations import (
    DEPTH_NAMES,
    change_json,
    compare,
    depth_prediction,
    depth_scene_and_baseline,
    depth_truth,
    evaluate,
    evaluated_depth,
    forge,
    scene_and_baseline,
)
from evaluation.depth.folders import COURTYARD, evaluate_depth, write_arrays, write_eth3d
from evaluation.depth.folders import write_run as write_depth_run
from evaluation.detection_runs import random_predictions, random_truth

from legoworld.comparison.compatibility import IncomparableError, _short, distinct_names
from legoworld.errors import LegoWorldError, UsageError
from legoworld.evaluation.stored import EvaluationChangedError
from legoworld.records.base import UNSET
from legoworld.records.folders.read_evaluation import EvaluationFolderError


def refuses(sides, output, match, error: type[LegoWorldError] = IncomparableError, **options):
    with pytest.raises(error, match=match):
        compare(sides, output, **options)
    assert not (output / "comparison.json").exists()


def other_evaluation(folder, truth=None, **options):
    """A baseline's evaluation over `random_truth("coco", seed=1)` or what is given."""
    truth = truth or random_truth("coco", seed=1)
    predictions = random_predictions("coco", truth, seed=3)
    return evaluate(folder, "coco", truth, predictions, **{"kind": "baseline", **options})


@pytest.fixture
def scene(tmp_path):
    truth = random_truth("coco", seed=1)
    predictions = random_predictions("coco", truth, seed=2, levels=1)
    return evaluate(tmp_path / "scene", "coco", truth, predictions, track_sha256="aa" * 32)


def rewritten(folder, name, change):
    """A file changed, with its new hash on record: another evaluation, not a damaged one."""
    forge(folder, name, lambda path: change_json(path, change))


def test_another_truth(scene, tmp_path):
    truth = random_truth("coco", seed=1)
    truth["annotations"][0]["area"] += 1
    other = other_evaluation(tmp_path / "b", truth)
    refuses((scene, other), tmp_path / "out", r"found: truth \w{12} and \w{12}; expected")


@pytest.mark.parametrize("fact", ["n_truth", "n_ignored_truth"])
def test_rows_that_count_another_truth(fact, scene, tmp_path):
    other = other_evaluation(tmp_path / "b")

    def one_more(path):
        rows = [json.loads(line) for line in path.read_text().splitlines()]
        rows[2][fact] += 1
        path.write_text("".join(json.dumps(row) + "\n" for row in rows))

    forge(other, "per_image.jsonl", one_more)
    refuses((scene, other), tmp_path / "out", r"found: the ground truth of image 16; expected")


def test_another_track(scene, tmp_path):
    other = other_evaluation(tmp_path / "b", track_sha256="bb" * 32)
    refuses((scene, other), tmp_path / "out", "found: track aaaaaaaaaaaa and bbbbbbbbbbbb")
    same = other_evaluation(tmp_path / "c", track_sha256="aa" * 32)
    compare((scene, same), tmp_path / "same")
    unrecorded = other_evaluation(tmp_path / "d")  # its images decide, and they are the same
    compare((scene, unrecorded), tmp_path / "unrecorded")


def test_other_images(scene, tmp_path):
    truth = random_truth("coco", seed=1)
    first = truth["images"].pop(0)["id"]
    truth["annotations"] = [a for a in truth["annotations"] if a["image_id"] != first]
    other = other_evaluation(tmp_path / "b", truth)
    refuses(
        (scene, other), tmp_path / "out", r"found: .*images: 1 on one side, such as 10 \(000.jpg\)"
    )


def test_another_evaluator(scene, tmp_path):
    fast = other_evaluation(tmp_path / "b", evaluator="fast")
    refuses((scene, fast), tmp_path / "out", r"found: evaluator pycocotools \S+ and hotcoco \S+")
    newer = other_evaluation(tmp_path / "c")
    rewritten(newer, "summary.json", lambda s: s["evaluator"].update(version="99"))
    refuses(
        (scene, newer), tmp_path / "out", r"found: evaluator pycocotools \S+ and pycocotools 99"
    )


def test_another_card(scene, tmp_path):
    other = other_evaluation(tmp_path / "b")
    change_json(other / "evidence.json", lambda e: e["configuration"].update(card_sha256="cc" * 32))
    refuses((scene, other), tmp_path / "out", r"found: card \w{12} and cccccccccccc")


def test_another_dataset_version_and_other_categories(scene, tmp_path):
    other = other_evaluation(tmp_path / "b")
    rewritten(other, "summary.json", lambda s: s.update(dataset_version="2014"))
    refuses((scene, other), tmp_path / "out", "found: dataset version custom and 2014")
    third = other_evaluation(tmp_path / "c")
    rewritten(
        third, "view/run.json", lambda r: r["configuration"].update(vocabulary_sha256="d" * 64)
    )
    refuses((scene, third), tmp_path / "out", r"found: categories \w{12} and dddddddddddd")


def test_another_task(scene, tmp_path):
    lvis, _ = scene_and_baseline(tmp_path / "l", "lvis")
    refuses((scene, lvis), tmp_path / "out", "found: task coco and lvis")
    depth, _ = depth_scene_and_baseline(tmp_path / "d")
    refuses((depth, scene), tmp_path / "out", "found: task eth3d and coco")


def test_a_partial_run_on_either_side(scene, tmp_path):
    other = other_evaluation(tmp_path / "b", partial=True)
    refuses((scene, other), tmp_path / "out", "partial run")
    refuses((other, scene), tmp_path / "out", "partial run")


def test_prompts_from_truth_are_allowed_by_name_and_printed_beside_the_score(scene, tmp_path):
    used = {"sha256": "e" * 64, "what": "categories of instances.json"}
    other = other_evaluation(tmp_path / "b", used_truth=used, baseline="prompted")
    refuses((scene, other), tmp_path / "out", "prompted with the ground truth.*instances.json")
    document = compare((scene, other), tmp_path / "out", allow_truth_prompts=True)
    assert document["methods"][1]["used_truth"] == used
    for suffix in ("md", "tex", "csv"):
        for name in ("table", "coverage"):
            text = (tmp_path / "out" / f"{name}.{suffix}").read_text()
            assert "prompted (prompted with truth)" in text
    assert any("instances.json" in note for note in document["notes"])


def test_a_changed_evaluation(scene, tmp_path):
    other = other_evaluation(tmp_path / "b")
    change_json(other / "summary.json", lambda s: s["metrics"].update(AP=0.99))
    refuses((scene, other), tmp_path / "out", "is not what was written",
            EvaluationChangedError)  # fmt: skip
    (other / "matches.npz").unlink()
    change_json(other / "evidence.json", lambda e: e["files"].pop("matches.npz"))
    refuses((scene, other), tmp_path / "out", r"no matches\.npz", EvaluationChangedError)


def test_what_is_no_evaluation(scene, tmp_path):
    (tmp_path / "empty").mkdir()
    refuses((scene, tmp_path / "empty"), tmp_path / "out", "no finished", EvaluationFolderError)
    refuses((scene,), tmp_path / "out", "two evaluations", UsageError)


def test_the_folder_of_an_evaluation_is_not_written_into(scene, tmp_path):
    other = other_evaluation(tmp_path / "b")
    before = {p: p.read_bytes() for p in scene.rglob("*") if p.is_file()}
    with pytest.raises(LegoWorldError, match="other than a comparison"):
        compare((scene, other), scene, overwrite=True)
    assert {p: p.read_bytes() for p in scene.rglob("*") if p.is_file()} == before


def test_another_comparison_in_the_folder(scene, tmp_path):
    other = other_evaluation(tmp_path / "b")
    compare((scene, other), tmp_path / "out", draws=5)
    compare((scene, other), tmp_path / "out", draws=5)
    with pytest.raises(LegoWorldError, match=r"different comparison.*draws: 5 -> 6"):
        compare((scene, other), tmp_path / "out", draws=6)
    assert compare((scene, other), tmp_path / "out", draws=6, overwrite=True)
    third = other_evaluation(tmp_path / "c", baseline="other")
    with pytest.raises(LegoWorldError, match=r"different comparison.*evaluation 1"):
        compare((scene, third), tmp_path / "out", draws=6)


def test_distinct_names():
    assert distinct_names([("scene", "a"), ("dino", "b")]) == ["scene", "dino"]
    assert distinct_names([("scene", "a"), ("scene", "b")]) == ["scene (a)", "scene (b)"]
    assert distinct_names([("scene", "a"), ("scene", "a")]) == ["scene (a) 1", "scene (a) 2"]


def resampled_depth():
    """Predictions at half the size of the truth."""
    return {
        name: z[::2, ::2] if isinstance(z, np.ndarray) else z
        for name, z in depth_prediction(0.3, seed=1).items()
    }


def depth_run(folder, predictions, *, kind="scene", **configuration):
    """The evaluation of a depth run whose configuration says more."""
    truth = folder.parent / "truth"
    made = write_depth_run(folder / "run", predictions, kind=kind)
    change_json(made / "run.json", lambda r: r["configuration"].update(configuration))
    evaluate_depth(made, truth, folder / "eval", draws=5)
    return folder / "eval"


def test_a_scene_read_out_smaller_stands_beside_nothing_of_full_size(tmp_path):
    write_arrays(tmp_path / "truth", depth_truth())
    full = depth_run(tmp_path / "full", depth_prediction(0.3, seed=1))
    small = depth_run(tmp_path / "small", resampled_depth(), max_side=20)
    again = depth_run(tmp_path / "again", resampled_depth(), max_side=20)
    large = depth_run(tmp_path / "large", depth_prediction(0.3, seed=1), max_side=4000)
    network = depth_run(tmp_path / "network", resampled_depth(), kind="baseline")
    upsampled = depth_run(tmp_path / "up", depth_prediction(0.1, seed=3), kind="baseline")
    refuses((small, full), tmp_path / "o", "depth resampled from 20 px and of full size")
    refuses((full, small), tmp_path / "o", "depth of full size and resampled from 20 px")
    refuses((small, upsampled), tmp_path / "o", "resampled from 20 px and 4 images of full size")
    compare((small, again), tmp_path / "1")
    compare((small, network), tmp_path / "2")
    compare((full, large), tmp_path / "3")
    document = compare((full, network), tmp_path / "4")
    assert any("4 of 4 depth maps are smaller than the truth" in n for n in document["notes"])


def test_camera_models_may_differ_between_a_scene_and_a_baseline_alone(tmp_path):
    names = DEPTH_NAMES[:4]
    camera = COURTYARD.replace("6048 4032 3411.42 3410.02 3041.29 2014.07", "40 30 30 30 20 15")
    truth = {name: z for name, z in depth_truth().items() if name in names}
    predictions = {name: z for name, z in depth_prediction(0.3, seed=1).items() if name in names}
    root = write_eth3d(tmp_path / "truth", truth, camera=camera)

    def evaluated_as(name, kind, camera_model):
        made = write_depth_run(tmp_path / name, predictions, kind=kind)
        evaluate_depth(made, root, tmp_path / f"{name}-eval", camera_model=camera_model, draws=5)
        return tmp_path / f"{name}-eval"

    warped = evaluated_as("warped", "scene", "dataset")
    flat = evaluated_as("flat", "scene", "none")
    baseline = evaluated_as("baseline", "baseline", "none")
    refuses((warped, flat), tmp_path / "o", "found: camera model dataset and none")
    document = compare((warped, baseline), tmp_path / "o")
    assert [m["camera_model"] for m in document["methods"]] == ["dataset", "none"]
    assert any(n.startswith("Camera model: scene dataset, ") for n in document["notes"])
    assert "camera_model" not in document["protocol"]
    compare((flat, baseline), tmp_path / "p")
    # Two scenes, both warped: by one calibration only.
    other = write_eth3d(tmp_path / "other", truth, camera=camera.replace("30 30 20", "31 30 20"))
    compare((warped, evaluated_as("both", "scene", "dataset")), tmp_path / "q")
    made = write_depth_run(tmp_path / "elsewhere", predictions)
    evaluate_depth(made, other, tmp_path / "elsewhere-eval", camera_model="dataset", draws=5)
    refuses((warped, tmp_path / "elsewhere-eval"), tmp_path / "o2", "found: calibration; expected")


def test_another_depth_truth(tmp_path):
    scene, _ = depth_scene_and_baseline(tmp_path / "one")
    (tmp_path / "two").mkdir()
    other = evaluated_depth(tmp_path / "two" / "b", depth_prediction(0.1, seed=4), kind="baseline")
    compare((scene, other), tmp_path / "fine")
    rows = (other / "per_image.jsonl").read_text().replace('"n_valid":3', '"n_valid":4')
    assert rows != (other / "per_image.jsonl").read_text()
    forge(other, "per_image.jsonl", lambda path: path.write_text(rows))
    refuses((scene, other), tmp_path / "out", "the ground truth of image 5")
    rows = rows.replace('"n_valid":4', '"n_valid":3')
    rows = rows.replace('"truth_wh":[40,30]', '"truth_wh":[40,31]', 1)
    forge(other, "per_image.jsonl", lambda path: path.write_text(rows))
    refuses((scene, other), tmp_path / "out", r"found: the ground truth of image \d; expected")
    evidence = json.loads((scene / "evidence.json").read_text())
    assert sum(e["role"] == "truth" for e in evidence["inputs"]) == 5


def test_a_hash_that_is_left_out_is_as_one_that_is_null():
    """Of depth, which has no categories: a run of another program may leave the field out."""
    assert _short(UNSET) == _short(None) == "not recorded"
    assert _short("ab" * 32) == "abababababab"
