"""examples/adapters: a view in the tools of others, each where its package is installed."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import shutil
import warnings
from types import ModuleType

import cv2
import numpy as np
import pytest
from checkout import CHECKOUT

import legoworld

ADAPTERS = CHECKOUT / "examples" / "adapters"


@pytest.fixture(scope="module")
def view(tmp_path_factory):
    folder = tmp_path_factory.mktemp("adapters") / "coffee"
    shutil.copytree(CHECKOUT / "examples" / "coffee", folder)
    return legoworld.open_scene(folder, source="glb").view(task="coco", size_wh=(60, 40))


@pytest.fixture
def photo(tmp_path):
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((40, 60, 3), 90, np.uint8))
    return tmp_path / "photo.png"


def adapter(name: str, package: str | None = None) -> ModuleType:
    """An adapter's module; the test is skipped where its package is not installed.

    By its metadata: the folder datasets/ of a checkout can be imported by that name.
    """
    try:
        importlib.metadata.version(package or "legoworld")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip(f"an adapter's package is not installed: {package}")
    spec = importlib.util.spec_from_file_location(name, ADAPTERS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with warnings.catch_warnings(action="ignore"):  # what it imports may warn of its own parts
        spec.loader.exec_module(module)
    return module


def test_supervision_has_the_view_s_boxes_and_masks(view):
    found = adapter("to_supervision", "supervision").to_supervision(view)
    assert len(found) == len(view.labelled) > 1
    assert (found.mask == view.masks()).all()
    assert found.data["class_name"].tolist() == [i.category for i in view.labelled]
    x, y, w, h = view.labelled[0].bbox_xywh_px
    assert found.xyxy[0].tolist() == [x, y, x + w, y + h]


def test_rerun_writes_a_recording(view, tmp_path):
    adapter("to_rerun", "rerun-sdk").to_rerun(view, tmp_path / "view.rrd")
    assert (tmp_path / "view.rrd").stat().st_size > 1000


def test_fiftyone_has_a_detection_for_each_instance(view, photo):
    sample = adapter("to_fiftyone", "fiftyone").to_fiftyone(view, photo)
    found = sample["scene"].detections
    assert [one.label for one in found] == [i.category for i in view.labelled]
    assert [int(one.mask.sum()) for one in found] == [i.area_px for i in view.labelled]
    assert all(0 <= part <= 1 for one in found for part in one.bounding_box)


def test_rows_for_a_dataset_are_plain_values(view, photo):
    (row,) = adapter("to_hf_datasets").rows({str(photo): view})
    assert (row["image"], row["width"], row["height"]) == (str(photo), 60, 40)
    assert [one["category"] for one in row["objects"]] == [i.category for i in view.labelled]
    assert [one["area_px"] for one in row["objects"]] == view.masks().sum((1, 2)).tolist()


def test_a_hugging_face_dataset_has_images_and_class_labels(view, photo):
    made = adapter("to_hf_datasets", "datasets").to_hf_datasets({str(photo): view})
    (row,) = made
    assert row["image"].size == (60, 40)
    feature = made.features["objects"]
    label = (feature[0] if isinstance(feature, list) else feature.feature)["category"]
    shown = [label.int2str(one["category"]) for one in row["objects"]]
    assert shown == [i.category for i in view.labelled]


def test_torchvision_s_detector_learns_from_views(view):
    module = adapter("train_torchvision", "torchvision")
    module.torch.manual_seed(0)
    losses = module.train([view], 12)
    assert np.isfinite(losses).all()
    assert sum(losses[-4:]) < sum(losses[:4])
