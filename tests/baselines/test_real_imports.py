"""Real results files and real depth, imported and scored: the numbers are the detectors' own."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from baselines.tracks import call, rows

pytestmark = pytest.mark.real_data


def evaluate_run(run: Path, truth: Path, tmp_path: Path) -> dict:
    output = tmp_path / f"eval-{run.name}"
    assert call(["evaluate", run, "--truth", truth, "-o", output, "--draws", "5"]) == 0
    summary: dict = json.loads((output / "summary.json").read_text())
    return summary


def import_results(source: Path, truth: Path, task: str, tmp_path: Path, *options: object) -> Path:
    tmp_path.mkdir(exist_ok=True)
    track, run = tmp_path / f"{task}.json", tmp_path / f"run-{task}"
    assert call(["track", "make", "--task", task, "--truth", truth, "-o", track]) == 0
    arguments = ["baseline", "import", source, "--task", task, "--track", track, "-o", run]
    assert call([*arguments, *options]) == 0
    return run


def test_yolox_nano_on_188_photos_of_val2017(real_data, tmp_path):
    truth = real_data / "coco/instances_val2017_188.json"
    source = real_data / "coco/yolox_nano_val2017_188_results.json"
    run = import_results(source, truth, "coco", tmp_path, "--name", "YOLOX-nano")
    summary = evaluate_run(run, truth, tmp_path)
    assert summary["metrics"]["AP"] == pytest.approx(0.280785, abs=5e-7)
    stats = json.loads((real_data / "coco/yolox_nano_val2017_188_stats.json").read_text())
    assert summary["official"] == pytest.approx(stats, abs=1e-12)  # pycocotools' own, kept with it
    assert summary["coverage"]["attempted"] == 188


@pytest.mark.parametrize(
    ("truth", "results", "task"),
    [
        ("coco/instances_val2017_188.json", "coco/yolox_nano_val2017_188_results.json", "coco"),
        ("evaluators/instances_val2014_100.json",
         "evaluators/instances_val2014_fakebbox100_results.json", "coco"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("only", [range(80), range(79), range(1, 79), range(1, 11)])
def test_real_files_in_each_numbering(real_data, tmp_path, capfd, truth, results, task, only):
    """Ids of the dataset pass where more than a few say so; any other is named or asked about.

    only: the places in COCO's list of the categories that are kept.
    """
    truth, entries = real_data / truth, json.loads((real_data / results).read_text())
    track = tmp_path / "track.json"
    assert call(["track", "make", "--task", task, "--truth", truth, "-o", track]) == 0
    own = sorted(c["id"] for c in json.loads(track.read_text())["categories"])
    place = {i: own.index(i) for i in own}
    kept = [e for e in entries if place[e["category_id"]] in only]
    ids = {"dataset": own, "coco80-0": range(80), "coco80-1": range(1, 81)}
    for name, written in ids.items():
        path = tmp_path / f"{name}.json"
        path.write_text(
            json.dumps([{**e, "category_id": written[place[e["category_id"]]]} for e in kept])
        )
        run = tmp_path / f"run-{name}"
        words = ["baseline", "import", path, "--task", task, "--track", track, "-o", run]
        capfd.readouterr()
        code, said = call(words), capfd.readouterr().err
        # Places 0 to 10 are numbered alike from 1 on: as coco80-1 they are the dataset's own.
        alike = name == "coco80-1" and only == range(1, 11)
        if code == 0:
            assert name == "dataset" or alike, "other categories than the detector's"
        else:
            assert f"--category-ids {name}" in said or alike
            assert not run.exists()
            assert call([*words, "--category-ids", name]) == 0
        if name == "dataset" and only in (range(80), range(79), range(1, 79)):
            assert code == 0, "real ids of the dataset need no word"


def test_its_boxes_written_as_corners_are_the_same_run(real_data, tmp_path):
    truth = real_data / "coco/instances_val2017_188.json"
    entries = json.loads((real_data / "coco/yolox_nano_val2017_188_results.json").read_text())
    for entry in entries:
        x, y, w, h = entry["bbox"]
        entry["bbox"] = [x, y, x + w, y + h]
    (tmp_path / "corners.json").write_text(json.dumps(entries))
    run = import_results(tmp_path / "corners.json", truth, "coco", tmp_path, "--box-format", "xyxy")
    source = real_data / "coco/yolox_nano_val2017_188_results.json"
    own = import_results(source, truth, "coco", tmp_path / "own")
    ours, theirs = (json.loads((r / "predictions.json").read_text()) for r in (own, run))
    assert [p["score"] for p in ours] == [p["score"] for p in theirs]
    boxes = [[p["bbox"] for p in found] for found in (ours, theirs)]
    np.testing.assert_allclose(*boxes, rtol=0, atol=1e-12)  # the last bit of x + w - x
    # Undeclared, they are refused, not scored.
    arguments = ["baseline", "import", tmp_path / "corners.json", "--task", "coco"]
    arguments += ["--track", tmp_path / "coco.json", "-o", tmp_path / "wrong"]
    assert call(arguments) == 2
    assert not (tmp_path / "wrong").exists()


def test_lvis_results(real_data, tmp_path):
    truth = real_data / "lvis/lvis_val_100.json"
    source = real_data / "lvis/lvis_val_100_synthetic_results.json"
    run = import_results(source, truth, "lvis", tmp_path)
    summary = evaluate_run(run, truth, tmp_path)
    assert summary["metrics"]["AP"] == pytest.approx(0.305714, abs=5e-7)


def test_the_masks_of_cocoapis_own_sample(real_data, tmp_path):
    """On a track made for boxes: the published twelve numbers, to the digits that are printed."""
    truth = real_data / "evaluators/instances_val2014_100.json"
    source = real_data / "evaluators/instances_val2014_fakesegm100_results.json"
    track, run = tmp_path / "track.json", tmp_path / "run"
    assert call(["track", "make", "--task", "coco", "--truth", truth, "-o", track]) == 0
    arguments = ["baseline", "import", source, "--task", "coco-masks", "--track", track, "-o", run]
    assert call(arguments) == 0
    official = evaluate_run(run, truth, tmp_path)["official"]
    assert official[0] == pytest.approx(0.319545, abs=5e-7)
    printed = (real_data / "evaluators/val2014_fake_eval_res.txt").read_text(encoding="utf-8")
    block = printed.split("type=segm\n")[1].split("-----")[0]
    expected = [float(x.rsplit("=", 1)[1]) for x in block.splitlines() if "@[" in x]
    assert [round(x, 3) for x in official] == expected


def test_renumbered_images_keep_their_photos(real_data, tmp_path):
    """The detector's boxes as a dataset tool exports them, on 12 of its 188 photos."""
    truth = real_data / "coco/instances_val2017_188.json"
    source = real_data / "coco/yolox_nano_val2017_188_results.json"
    photos = json.loads(truth.read_text())["images"]
    number = {photo["id"]: n for n, photo in enumerate(photos, start=1)}
    track = tmp_path / "track.json"
    make = ["track", "make", "--task", "coco", "--truth", truth, "--sample", "12", "-o", track]
    assert call(make) == 0
    entries = json.loads(source.read_text())
    whole = {
        "images": [{"id": number[p["id"]], "file_name": p["file_name"]} for p in photos],
        "annotations": [{**e, "image_id": number[e["image_id"]]} for e in entries],
    }
    (tmp_path / "whole.json").write_text(json.dumps(whole))
    runs = []
    for path in (source, tmp_path / "whole.json"):
        runs.append(tmp_path / f"run-{path.stem}")
        words = ["baseline", "import", path, "--task", "coco", "--track", track, "--subset"]
        assert call([*words, "-o", runs[-1]]) == 0
    ours, theirs = ((run / "predictions.json").read_bytes() for run in runs)
    assert ours == theirs
    # Without their names the numbers are places in a list, and some are ids of other photos.
    (tmp_path / "bare.json").write_text(json.dumps(whole["annotations"]))
    words = ["baseline", "import", tmp_path / "bare.json", "--task", "coco", "--track", track]
    assert call([*words, "--subset", "-o", tmp_path / "bare"]) == 2
    assert not (tmp_path / "bare").exists()


@pytest.fixture
def kinect(real_data: Path, tmp_path: Path) -> tuple[Path, Path, Path]:
    """(real depth in mm, the same as truth, a track) of five frames of a moving camera."""
    folder = real_data / "depth/open3d/RGBD/depth"
    if not folder.is_dir():
        pytest.skip("the RGB-D frames are not among the real data here")
    names = [f"{n:05}" for n in range(5)]
    truth = tmp_path / "truth"
    truth.mkdir()
    for name in names:
        shutil.copy(folder / f"{name}.png", truth)
    (truth / "depth.toml").write_text('space = "depth"\nunit = "mm"\n')
    images = [
        {"id": n, "file_name": f"{name}.jpg", "width": 640, "height": 480}
        for n, name in enumerate(names, start=1)
    ]
    track = tmp_path / "track.json"
    track.write_text(json.dumps({"info": {}, "images": images, "categories": []}))
    return folder, truth, track


def test_real_depth_is_its_own_prediction(kinect, tmp_path):
    folder, truth, track = kinect
    run = tmp_path / "run"
    arguments = ["baseline", "import", folder, "--task", "eth3d", "--track", track, "-o", run]
    assert call([*arguments, "--space", "depth", "--unit", "mm"]) == 0
    measured = np.count_nonzero(cv2.imread(str(folder / "00000.png"), cv2.IMREAD_UNCHANGED))
    assert rows(run)[1]["depth"]["finite_px"] == measured
    summary = evaluate_run(run, truth, tmp_path)
    assert summary["coverage"]["scored"] == 5
    assert summary["metrics"]["abs_rel"]["error_1"] < 1e-9


def test_real_ray_distance_is_undone_and_matters(kinect, tmp_path):
    """The sensor's planar depth, made into distances by its own intrinsics, comes back."""
    folder, truth, track = kinect
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    stretch = np.sqrt(1 + ((u + 0.5 - 320) / 525) ** 2 + ((v + 0.5 - 240) / 525) ** 2)
    (tmp_path / "rays").mkdir()
    for path in sorted(folder.glob("*.png")):
        z = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) / 1000
        np.save(tmp_path / "rays" / f"{path.stem}.npy", z * stretch)
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps({"fx": 525, "fy": 525, "cx": 320, "cy": 240}))
    arguments = ["baseline", "import", tmp_path / "rays", "--task", "eth3d", "--track", track]
    right, wrong = tmp_path / "right", tmp_path / "wrong"
    as_rays = ["--space", "ray_distance", "--unit", "m", "--intrinsics", camera]
    assert call([*arguments, "-o", right, *as_rays]) == 0
    assert call([*arguments, "-o", wrong, "--space", "depth", "--unit", "m"]) == 0
    scores = [evaluate_run(run, truth, tmp_path)["metrics"]["abs_rel"] for run in (right, wrong)]
    assert scores[0]["error_1"] < 1e-9
    assert scores[1]["error_1"] > 0.01


@pytest.mark.parametrize(
    ("task", "iou_type", "ap"), [("coco", "bbox", 0.504581), ("coco-masks", "segm", 0.319545)]
)
def test_cocoapis_own_samples_have_their_published_ap(task, iou_type, ap, real_data, tmp_path):
    """Its files have equal scores inside images and categories, in an order of their own."""
    truth = real_data / "evaluators/instances_val2014_100.json"
    source = real_data / f"evaluators/instances_val2014_fake{iou_type}100_results.json"
    summary = evaluate_run(import_results(source, truth, task, tmp_path), truth, tmp_path)
    assert round(summary["metrics"]["AP"], 6) == ap
