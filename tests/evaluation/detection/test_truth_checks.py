"""A truth file is checked as strictly as predictions: counted, the first offender named."""

from __future__ import annotations

import copy
import json
import math

import pytest
from evaluation.detection_runs import random_predictions, random_truth, write_run, write_truth

from legoworld.errors import LegoWorldError
from legoworld.evaluation.detection.inputs.truth import read_truth
from legoworld.evaluation.detection.inputs.truth_checks import TruthInvalidError
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.run import read_run
from legoworld.track_making.make_track import make_track

TRIANGLE = [1.0, 1.0, 5.5, 1.0, 5.0, 5.0]


def annotation(**change):
    return lambda t: t["annotations"][1].update(change)


def image(**change):
    return lambda t: t["images"][3].update(change)


def without(kind, key):
    return lambda t: t[kind][1].pop(key)


#: Case: (task, what is changed, how many of how many, the found offender, a word of the advice).
FAULTS = {
    "an unknown image": ("coco", annotation(image_id=999), "1 of 33 annotations",
        "annotation 2 (image 999): no such image", "correct the image_id"),
    "an image id in words": ("coco", annotation(image_id="10"), "1 of 33 annotations",
        "annotation 2 (image '10'): image_id '10'", "correct the file"),
    "a bool for an image": ("coco", annotation(image_id=True), "1 of 33 annotations",
        "image_id True", "correct"),
    "half an image id": ("coco", annotation(image_id=10.5), "1 of 33", "image_id 10.5", ""),
    "no image": ("coco", without("annotations", "image_id"), "1 of 33", "no image_id", ""),
    "a list for an image": ("coco", annotation(image_id=[10]), "1 of 33", "image_id [10]", ""),
    "no annotation id": ("coco", without("annotations", "id"), "1 of 33 annotations",
        "annotation number 2 of the list: no id", ""),
    "no annotation ids": ("coco", lambda t: [a.pop("id") for a in t["annotations"]],
        "33 of 33 annotations", "annotation number 1 of the list: no id", ""),
    "an annotation id in words": ("coco", annotation(id="2"), "1 of 33", "id '2'", ""),
    "ids twice": ("coco", annotation(id=1), "ids repeat",
        "33 annotations, 32 ids: annotation 1 2 times", ""),
    "a negative width": ("coco", annotation(bbox=[9, 9, -3, 4]), "1 of 33 annotations",
        "annotation 2 (image 10): bbox [9, 9, -3, 4]", ""),
    "three numbers": ("coco", annotation(bbox=[9, 9, 3]), "1 of 33", "bbox [9, 9, 3]", ""),
    "a NaN box": ("coco", annotation(bbox=[1, 2, 3, math.nan]), "1 of 33", "nan]", ""),
    "a box of words": ("coco", annotation(bbox="1234"), "1 of 33", "bbox '1234'", ""),
    "a box no float holds": ("coco", annotation(bbox=[1, 2, 3, 10**400]), "1 of 33", "bbox", ""),
    "no box": ("coco", without("annotations", "bbox"), "1 of 33", "no bbox", ""),
    "an unknown category": ("coco", annotation(category_id=1), "1 of 33", "category_id 1", ""),
    "a bool for a category": ("coco", annotation(category_id=True), "1 of 33", "True", ""),
    "no category": ("coco", without("annotations", "category_id"), "1 of 33", "no category", ""),
    "no area": ("coco", without("annotations", "area"), "1 of 33 annotations",
        "no area", "write the area"),
    "a negative area": ("coco", annotation(area=-1), "1 of 33", "area -1", "write the area"),
    "an infinite area": ("coco", annotation(area=math.inf), "1 of 33", "area inf", ""),
    "half a crowd": ("coco", annotation(iscrowd=0.5), "1 of 33", "iscrowd 0.5", ""),
    "a crowd of two": ("coco", annotation(iscrowd=2), "1 of 33", "iscrowd 2", ""),
    "no object": ("coco", lambda t: t["annotations"].append(7), "1 of 34",
        "annotation number 34 of the list: 7", ""),
    "corners": ("coco", lambda t: [a.update(bbox=[a["bbox"][0], a["bbox"][1],
        a["bbox"][0] + a["bbox"][2], a["bbox"][1] + a["bbox"][3]]) for a in t["annotations"]],
        "truth.json are not x, y, width, height", "leave their image",
        "these look like x1, y1, x2, y2: write x, y"),
    "images twice": ("coco", lambda t: t["images"].append(dict(t["images"][1])), "ids repeat",
        "1 of 13 images, such as image 13", ""),
    "an image in words": ("coco", image(id="19"), "1 of 12 images", "id '19'", ""),
    "an image that is true": ("coco", image(id=True), "1 of 12 images", "id True", ""),
    "an image without an id": ("coco", lambda t: t["images"][3].pop("id"), "1 of 12 images",
        "image number 4 of the list: no id", ""),
    "an image of no object": ("coco", lambda t: t["images"].append("x"), "1 of 13 images",
        "image number 13 of the list: 'x'", ""),
    "no mask": ("lvis", without("annotations", "segmentation"), "1 of 29 annotations",
        "annotation 2 (image 10): no segmentation", "correct"),
    "no polygon": ("lvis", annotation(segmentation=[]), "1 of 29", "no segmentation", ""),
    "words for a mask": ("lvis", annotation(segmentation="abc"), "1 of 29", "'abc'", ""),
    "two points": ("lvis", annotation(segmentation=[[1, 1, 5, 5]]), "1 of 29",
        "a polygon of 4 numbers", ""),
    "half a point": ("lvis", annotation(segmentation=[TRIANGLE, [*TRIANGLE, 7]]), "1 of 29",
        "a polygon of 7 numbers", ""),
    "a NaN point": ("lvis", annotation(segmentation=[[*TRIANGLE, 7, math.nan]]), "1 of 29",
        "no finite number", ""),
    "an infinite point": ("lvis", annotation(segmentation=[[*TRIANGLE, 7, math.inf]]), "1 of 29",
        "no finite number", ""),
    "a point in words": ("lvis", annotation(segmentation=[[*TRIANGLE, 7, "7"]]), "1 of 29",
        "no finite number", ""),
    "a flat polygon": ("lvis", annotation(segmentation=TRIANGLE), "1 of 29", "a polygon", ""),
    "RLE of another size": ("lvis", annotation(segmentation={"size": [9, 9], "counts": "11"}),
        "1 of 29", "RLE size [9, 9]", "image's [height, width]"),
    "cut RLE": ("lvis", annotation(segmentation={"size": [90, 120], "counts": "11"}), "1 of 29",
        "annotation 2 (image 10): RLE run lengths that add up to 2, 10800", ""),
    "foreign RLE": ("lvis", annotation(segmentation={"size": [90, 120], "counts": "é!"}),
        "1 of 29", "RLE no run lengths", ""),
    "RLE without counts": ("lvis", annotation(segmentation={"size": [90, 120]}), "1 of 29",
        "RLE {'size'", ""),
    "a list of counts too short": ("lvis", annotation(
        segmentation={"size": [90, 120], "counts": [5, 5]}), "1 of 29", "add up to 10", ""),
}  # fmt: skip


def read(folder, task, truth, whole=None):
    """The truth for a run over the images of a whole one."""
    predictions = random_predictions(task, whole or truth, seed=6)
    run = read_run(write_run(folder / "run", task, whole or truth, predictions))
    return read_truth(write_truth(folder / "truth.json", truth), detection_protocol(task), run)


def broken_truth(name):
    task, change, *_ = FAULTS[name]
    truth = random_truth(task, seed=6)
    broken = copy.deepcopy(truth)
    change(broken)
    return task, truth, broken


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_counted_and_named(name, tmp_path):
    task, truth, broken = broken_truth(name)
    _, _, count, found, advice = FAULTS[name]
    with pytest.raises(TruthInvalidError) as caught:
        read(tmp_path, task, broken, truth)
    said = str(caught.value)
    for words in (count, found, advice, "truth.json", "expected: ", "next: "):
        assert words in said
    assert "\n" not in said


@pytest.mark.parametrize("name", [name for name in FAULTS if name != "corners"])
def test_no_track_is_made_of_it(name, tmp_path):
    """Before a run that could not be scored; whether boxes fit their images is scoring's."""
    task, _, broken = broken_truth(name)
    path = write_truth(tmp_path / "truth.json", broken)
    with pytest.raises(TruthInvalidError):
        make_track(task, path, tmp_path / "track.json", sample=None, seed=0)
    assert not (tmp_path / "track.json").exists()


@pytest.mark.parametrize("size", [{"width": 0}, {"width": "120"}, {"height": 90.5}])
def test_an_image_without_a_size(size, tmp_path):
    truth = random_truth("coco", seed=6)
    broken = copy.deepcopy(truth)
    broken["images"][3].update(size)
    with pytest.raises(LegoWorldError, match="image 19"):
        read(tmp_path, "coco", broken, truth)
    path = write_truth(tmp_path / "truth.json", broken)
    with pytest.raises(TruthInvalidError, match="image 19: width"):
        make_track("coco", path, tmp_path / "track.json", sample=None, seed=0)


@pytest.mark.parametrize("value", [None, "5", [5, "7"], [True]])
def test_verified_categories_that_are_no_ids(value, tmp_path):
    truth = random_truth("lvis", seed=6)
    broken = copy.deepcopy(truth)
    broken["images"][3]["neg_category_ids"] = value
    with pytest.raises(TruthInvalidError, match="verified categories"):
        read(tmp_path, "lvis", broken, truth)


@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_annotations_of_images_outside_the_track_say_nothing(task, tmp_path):
    """A track is a part of its truth: neither a fault nor a warning, whatever they hold."""
    truth = random_truth(task, seed=6)
    part = {**truth, "images": truth["images"][:5]}
    outside = truth["images"][9]["id"]
    more = copy.deepcopy(truth)
    more["annotations"].append({"id": 777, "image_id": outside, "bbox": "none"})
    found = read(tmp_path, task, more, part)
    assert found.warnings == ()
    ids = {i["id"] for i in part["images"]}
    kept = [a for a in truth["annotations"] if a["image_id"] in ids]
    assert [a["bbox"] for a in found.annotations] == [a["bbox"] for a in kept]


def test_whole_numbers_written_as_decimals_are_taken_and_counted(tmp_path):
    """As pycocotools takes them: 10.0 finds the image 10."""
    truth = random_truth("coco", seed=6)
    decimal = copy.deepcopy(truth)
    for a in decimal["annotations"][:4]:
        a.update(image_id=float(a["image_id"]), category_id=float(a["category_id"]))
    decimal["images"][3]["id"] = float(decimal["images"][3]["id"])
    found = read(tmp_path / "decimal", "coco", decimal, truth)
    plain = read(tmp_path / "plain", "coco", truth)
    assert found.annotations == plain.annotations
    assert found.images == plain.images
    assert all(type(a["image_id"]) is int for a in found.annotations)
    assert found.warnings == (
        "4 category ids written as decimals, taken as integers",
        "5 image ids written as decimals, taken as integers",
    )


def test_odd_boxes_that_official_evaluators_score_are_counted(tmp_path):
    truth = random_truth("coco", seed=6, images=30)
    truth["annotations"][0]["bbox"][3] = 0
    truth["annotations"][1]["bbox"] = [100, 60, 24, 34]
    assert read(tmp_path, "coco", truth).warnings == (
        "1 truth boxes that leave their image by over 2 px",
        "1 truth boxes without any area",
    )


def test_a_truth_of_brackets_is_no_document(tmp_path):
    truth = random_truth("coco", seed=6)
    run = read_run(write_run(tmp_path / "run", "coco", truth, []))
    path = tmp_path / "truth.json"
    path.write_text("[" * 50_000 + "]" * 50_000)
    with pytest.raises(TruthInvalidError, match="cannot be read"):
        read_truth(path, detection_protocol("coco"), run)


@pytest.mark.real_data
def test_real_truths_are_taken_without_a_word(real_data, tmp_path):
    files = {
        "coco": ("coco/instances_val2017_188.json", "evaluators/instances_val2014_100.json"),
        "lvis": ("lvis/lvis_val_100.json",),
    }
    for task, names in files.items():
        for name in names:
            truth = json.loads((real_data / name).read_text())
            found = read(tmp_path / name, task, truth)
            assert found.warnings == ()
            assert len(found.annotations) == len(truth["annotations"])
