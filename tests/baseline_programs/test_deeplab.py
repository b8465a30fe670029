"""DeepLab: its input and its classes at the photo's size, by an interpreter that is made up.

ai-edge-litert asks for another numpy than the other baselines; baselines/deeplab/README.md has what
the trained model gave.
"""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from baseline_programs.child import ask_here, defaults, drawn_photo, importable, refusal, request

coco_mask = pytest.importorskip("pycocotools.mask")
importable("deeplab")

from deeplab_input import GREY, at_photo_size, entries, prepared  # noqa: E402

SIDE = 9
VOC = [{"id": number, "name": str(number)} for number in range(21)]


def test_a_photo_keeps_its_aspect_and_is_padded_with_grey():
    photo = np.full((20, 40, 3), 200, np.uint8)
    pixels, shown = prepared(photo, SIDE, "pad")
    assert shown == (4, 9)
    assert (pixels[:4] == 200).all()
    assert (pixels[4:] == GREY).all()
    pixels, shown = prepared(photo, SIDE, "stretch")
    assert shown == (SIDE, SIDE)
    assert (pixels == 200).all()


def test_classes_are_cut_and_enlarged_to_the_nearest():
    classes = np.zeros((4, 4), np.int64)
    classes[0, 1], classes[3] = 15, 9
    found = at_photo_size(classes, (2, 4), (8, 4))
    assert found.tolist() == [[0, 0, 15, 15, 0, 0, 0, 0]] * 2 + [[0] * 8] * 2
    (background, person) = entries(found, {0, 15})
    assert (background["category_id"], person["category_id"]) == (0, 15)
    assert coco_mask.decode(person["segmentation"]).sum() == 4


class Interpreter:
    """Says of each pixel whether its red is above one half: class 15 or 0."""

    def __init__(self, model_path: str, num_threads: int) -> None:
        if not model_path.endswith("good.tflite"):
            raise ValueError("not a model")
        assert num_threads == 1

    def allocate_tensors(self) -> None:
        self.given = np.zeros(1)

    def get_input_details(self):
        return [{"index": 0, "shape": np.array([1, SIDE, SIDE, 3]), "dtype": np.uint8}]

    def get_output_details(self):
        return [{"index": 7, "shape": np.array([1, SIDE, SIDE])}]

    def set_tensor(self, index: int, pixels: np.ndarray) -> None:
        assert (index, pixels.dtype) == (0, np.uint8)
        self.given = pixels

    def invoke(self) -> None:
        self.made = np.where(self.given[..., 0] > 127, 15, 0)

    def get_tensor(self, index: int) -> np.ndarray:
        assert index == 7
        return self.made


@pytest.fixture
def asked(tmp_path, monkeypatch):
    package, module = ModuleType("ai_edge_litert"), SimpleNamespace(Interpreter=Interpreter)
    monkeypatch.setitem(sys.modules, "ai_edge_litert", package)
    monkeypatch.setitem(sys.modules, "ai_edge_litert.interpreter", module)
    (tmp_path / "good.tflite").write_bytes(b"weights")
    photo = drawn_photo(tmp_path / "photo.png", (36, 18))
    more = {"categories": VOC, "options": defaults("deeplab")}
    return request("voc-semantic", tmp_path / "good.tflite", tmp_path, [photo], **more)


def test_a_photo_through_the_program(asked):
    said = ask_here("deeplab", asked)
    assert said.provenance["weight_files"][0]["name"] == "good.tflite"
    left, right = said.results[1]["predictions"]
    assert (left["category_id"], right["category_id"]) == (0, 15)
    mask = coco_mask.decode(right["segmentation"]).astype(bool)
    assert mask.shape == (18, 36)
    assert mask[:, 20:].all()
    assert not mask[:, :16].any()


@pytest.mark.parametrize(
    ("change", "said"),
    [({"device": "cuda"}, "runs on the CPU"), ({"weights": "absent"}, "one file"),
     ({"categories": VOC[1:]}, "not Pascal VOC's")],
)  # fmt: skip
def test_what_cannot_be_run_is_refused(asked, change, said):
    assert said in refusal("deeplab", {**asked, **change})["message"]


def test_a_file_that_is_no_model_is_refused(asked, tmp_path):
    (tmp_path / "bad.tflite").write_bytes(b"no")
    words = refusal("deeplab", {**asked, "weights": str(tmp_path / "bad.tflite")})
    assert words["found"] == "not a model"
