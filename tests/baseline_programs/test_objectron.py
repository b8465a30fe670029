"""Objectron by an interpreter that is made up; its README has what the trained networks gave."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from baseline_programs.child import ask_here, defaults, drawn_photo, importable, refusal, request

from legoworld.evaluation.box_overlaps import box_ious
from legoworld.visibility.cuboids import cuboid_corners

importable("objectron")

from objectron_box import SIGNS, box_in_space, camera_of, crop, square_around  # noqa: E402

CATEGORIES = [{"id": 47, "name": "cup"}, {"id": 62, "name": "chair"}, {"id": 1, "name": "person"}]
K = np.array([[300.0, 0, 170], [0, 320, 110], [0, 0, 1]])
REGION = {"image_id": 1, "category_id": 62, "bbox": [40, 30, 60, 80], "score": 0.5}
AXES = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
BOX = np.array([0.1, 0.2, 2.0]), AXES * np.linalg.det(AXES), np.array([0.5, 0.9, 0.4])
CORNERS = cuboid_corners(*BOX)


def project_box(camera: np.ndarray) -> np.ndarray:
    """The nine points of BOX in a photo."""
    center, axes, sizes = BOX
    points = np.vstack([np.zeros(3), SIGNS * sizes / 2]) @ axes.T + center
    return (points @ camera.T)[:, :2] / points[:, 2:]


def test_a_box_comes_back_from_its_points_at_its_height():
    found = box_in_space(project_box(K), K, 0.9)
    assert box_ious(found[None], CORNERS[None])[0, 0] == pytest.approx(1, abs=1e-6)
    np.testing.assert_allclose(box_in_space(project_box(K), K, 1.8), 2 * found, rtol=1e-9)
    assert box_in_space(np.full((9, 2), 50.0), K, 0.9) is None
    # From points that are off: a rectangular box that is near.
    found = box_in_space(project_box(K) + np.random.default_rng(0).normal(size=(9, 2)), K, 0.9)
    edges = found[[1, 3, 4]] - found[0]
    np.testing.assert_allclose(edges @ edges.T, np.diag((edges**2).sum(axis=1)), atol=1e-9)
    assert box_ious(found[None], CORNERS[None])[0, 0] > 0.5


def test_a_crop_is_square_and_repeats_the_edge():
    photo = np.zeros((20, 30, 3), np.uint8)
    photo[:, 10:] = 255
    assert square_around([12, 8, 4, 8]) == (8, 6, 12)
    assert crop(photo, (8.5, 6, 12), 12)[5, :, 0].tolist() == [0, 0.5] + [1] * 10
    assert (crop(photo, (-6, -6, 12), 6) == 0).all()
    assert (crop(photo, (25, 15, 20), 4) == 1).all()


class Interpreter(SimpleNamespace):
    """Gives the same points for every crop."""

    points = np.zeros((9, 2))

    def __init__(self, model_path: str, num_threads: int) -> None:
        if Path(model_path).read_text() != "good" or num_threads != 1:
            raise ValueError("not a model")
        self.allocate_tensors = self.invoke = lambda: None
        self.get_input_details = lambda: [{"index": 0}]
        self.get_output_details = lambda: [{"index": 4}, {"index": 9}]
        self.set_tensor = lambda _, pixels: np.testing.assert_equal(pixels.shape, (1, 224, 224, 3))
        self.get_tensor = lambda index: self.points if index == 4 else np.array([0.8])


@pytest.fixture
def asked(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ai_edge_litert", ModuleType("ai_edge_litert"))
    module = SimpleNamespace(Interpreter=Interpreter)
    monkeypatch.setitem(sys.modules, "ai_edge_litert.interpreter", module)
    for name in ("chair", "cup"):
        (tmp_path / f"object_detection_3d_{name}.tflite").write_text("good")
    (tmp_path / "regions.json").write_text(json.dumps([REGION, {**REGION, "category_id": 1}]))
    photo = drawn_photo(tmp_path / "photo.png", (160, 120))
    more = {"categories": CATEGORIES, "options": defaults("objectron")}
    return request("boxes3d", tmp_path, tmp_path, [photo], **more)


@pytest.mark.parametrize("images", [[], [{"id": 1, "K": K.tolist()}]])
def test_a_region_through_the_program(images, asked, tmp_path, monkeypatch):
    if images:
        document = {"images": images, "annotations": [REGION]}
        (tmp_path / "regions.json").write_text(json.dumps(document))
    left, top, side = square_around(REGION["bbox"])
    points = project_box(K if images else camera_of(60.0, (160, 120)))
    monkeypatch.setattr(Interpreter, "points", (points - [left, top]) / side * 224)
    said = ask_here("objectron", asked).results[1]
    (box,) = said["predictions"]
    assert said["counts"] == {"regions": 1, "without_box": 0}
    assert (box["category_id"], box["score"]) == (62, pytest.approx(0.4))
    assert box_ious(np.array([box["bbox3D"]]), CORNERS[None])[0, 0] == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "file", "said"),
    [({"device": "cuda"}, {}, "runs on the CPU"), ({"weights": "absent"}, {}, "lacks a file"),
     ({"categories": CATEGORIES[2:]}, {}, "no label"),
     ({"options": {**defaults("objectron"), "cup_height_m": 0.0}}, {}, "out of range"),
     ({}, {"object_detection_3d_cup.tflite": "bad"}, "cannot be loaded"),
     ({}, {"regions.json": "{}"}, "gives no regions"),
     ({}, {"regions.json": json.dumps([{**REGION, "bbox": [0, 0, 5, 0]}])}, "gives no regions"),
     ({}, {"regions.json": '{"images": [{"id": 1, "K": [1]}]}'}, "gives no regions")],
)  # fmt: skip
def test_what_cannot_be_run_is_refused(change, file, said, asked, tmp_path):
    for name, text in file.items():
        (tmp_path / name).write_text(text)
    assert said in refusal("objectron", {**asked, **change})["message"]
