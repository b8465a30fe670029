"""Single rules of the inputs and of the lines, each at its edge."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from legoworld.evaluation.detection.inputs.truth import (
    TruthMismatchError,
    _check_same_photo,
    _number_annotations,
)
from legoworld.evaluation.detection.payloads.amodal import _region, check_amodal
from legoworld.evaluation.detection.payloads.boxes3d import _frame_fault
from legoworld.evaluation.detection.text import _space_line
from legoworld.evaluation.run import RunImage

PHOTO = RunImage(image_id=7, file_name="val/photo.jpg", size_wh=(40, 30), status="ok")


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        ({}, True),
        ({"file_name": None, "coco_url": "http://images/val2017/photo.jpg"}, True),
        ({"file_name": "other.jpg", "coco_url": "http://images/val2017/photo.jpg"}, True),
        ({"file_name": "other.jpg"}, False),
        ({"file_name": None, "coco_url": None}, False),
    ],
)
def test_a_photo_is_the_truth_s_by_either_of_its_names(changes, same):
    entry = {"file_name": "photo.jpg", "width": 40, "height": 30, **changes}
    if same:
        _check_same_photo(Path("truth.json"), PHOTO, entry)
    else:
        with pytest.raises(TruthMismatchError, match="image 7 is another photo"):
            _check_same_photo(Path("truth.json"), PHOTO, entry)


def test_annotations_are_numbered_from_one_and_repairs_are_counted():
    repairs = Counter()
    given = [{"id": 0, "iscrowd": 1}, {"id": 9}, {"id": 4, "iscrowd": 0}]
    found = _number_annotations(given, SimpleNamespace(federated=False), repairs)
    assert found == [{"id": 1, "iscrowd": 1}, {"id": 2, "iscrowd": 0}, {"id": 3, "iscrowd": 0}]
    assert sorted(repairs.values()) == [1, 1]
    repairs.clear()
    found = _number_annotations(given[1:2], SimpleNamespace(federated=True), repairs)
    assert (found, dict(repairs)) == ([{"id": 1}], {})


def test_a_region_of_cocoa_is_an_annotation():
    corners = [4.0, 9.0, 10.0, 2.0, 7.0, 5.0]
    region = {"segmentation": corners, "area": 12.5, "occlude_rate": 0.25, "isStuff": 1}
    found = _region(3, 8, region)
    assert (found["bbox"], found["area"]) == ([4.0, 2.0, 6.0, 7.0], 12.5)
    assert (found["id"], found["image_id"], found["category_id"]) == (3, 8, 2)
    assert found["segmentation"] == [corners]
    assert _region(3, 8, {**region, "isStuff": 0})["category_id"] == 1


def test_what_is_hidden_has_an_empty_visible_mask_of_the_photo_s_size():
    square = [[2.0, 2.0, 9.0, 2.0, 9.0, 9.0, 2.0, 9.0]]
    entry = {"id": 1, "image_id": 5, "category_id": 1, "segmentation": square, "area": 49.0,
             "bbox": [2.0, 2.0, 7.0, 7.0], "iscrowd": 0, "visible_mask": []}  # fmt: skip
    check_amodal("truth.json", [entry], {5: {"id": 5, "width": 40, "height": 30}})
    assert entry["visible_mask"]["size"] == [30, 40]


def test_boxes_at_less_than_a_metre_are_before_the_camera():
    box = np.stack(np.meshgrid([0, 0.1], [0, 0.1], [0.5, 0.6]), axis=-1).reshape(8, 3)
    assert _frame_fault(np.stack([box] * 5)) == ("", "")
    behind = box * [1, 1, -1]
    found, advice = _frame_fault(np.stack([behind] * 3 + [box] * 2))
    assert found == "3 of 5 boxes behind the camera"
    assert "negate y and z" in advice
    assert _frame_fault(np.stack([behind] * 2 + [box] * 2)) == ("", ""), "a half is no majority"
    assert _frame_fault(np.stack([behind] * 3)) == ("", ""), "three boxes tell nothing"
    straddling = behind.copy()
    straddling[0, 2] = 0.1
    assert _frame_fault(np.stack([straddling] * 5)) == ("", "")


def test_errors_in_space_are_one_line():
    errors = SimpleNamespace(center_m=0.1234, volume_ratio=0.5, yaw_mod_90_deg=3.25, pairs=1)
    assert _space_line(errors) == (
        "medians over 1 pair that overlap: centres 0.123 m apart, 0.5000 of the true volume, "
        "yaw off by 3.2 degrees modulo 90"
    )
    errors.center_m = None
    assert _space_line(errors) == "no pair of boxes overlaps"
