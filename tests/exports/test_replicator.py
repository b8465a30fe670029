"""Replicator's files, read as readers of BasicWriter's output do."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from exports.made_views import made_view, two_plates

from legoworld.exports.replicator import color, write_views
from legoworld.readouts.pictures import write_png


def document(folder, name):
    return json.loads((folder / f"{name}_0000.json").read_text())


def picture(folder, name):
    bgra = cv2.imread(str(folder / f"{name}_0000.png"), cv2.IMREAD_UNCHANGED)
    return bgra[..., [2, 1, 0, 3]]


def masks(folder, name, mapping):
    """The mask of each entry that the JSON beside a picture names."""
    pixels = picture(folder, name)
    named = {key: (pixels == ast.literal_eval(key)).all(axis=2) for key in mapping}
    assert sum(mask.sum() for mask in named.values()) == pixels.shape[0] * pixels.shape[1]
    return {json.dumps(mapping[key]): mask for key, mask in named.items()}


@pytest.mark.parametrize(("moved", "ratio"), [(0.25, 0.5), (0.5, 1.0)])
def test_boxes_and_exact_occlusion(tmp_path, moved, ratio):
    view = two_plates(-moved) if ratio < 1 else two_plates(0)
    write_views([view], tmp_path / "out")
    folder = tmp_path / "out"
    tight, loose = (np.load(folder / f"bounding_box_2d_{k}_0000.npy") for k in ("tight", "loose"))
    labels = document(folder, "bounding_box_2d_tight_labels")
    named = {labels[str(row["semanticId"])]["class"]: row for row in loose}
    assert set(named) == {"wall", "sheet"}
    assert named["wall"]["occlusionRatio"] == ratio
    assert named["sheet"]["occlusionRatio"] == 0
    assert tuple(named["wall"])[1:5] == (25, 25, 74, 74)  # both ends included
    assert len(tight) == (2 if ratio < 1 else 1)  # what is hidden has no tight box
    if ratio < 1:
        shown = next(r for r in tight if labels[str(r["semanticId"])]["class"] == "wall")
        assert tuple(shown)[1:5] == (50, 25, 74, 74)
    assert tight.dtype == loose.dtype
    assert tight.dtype.names[-1] == "occlusionRatio"
    paths = document(folder, "bounding_box_2d_loose_prim_paths")
    assert paths == ["/0/A", "/1/B"]


def test_segmentations_name_every_colour(tmp_path):
    view = made_view(
        ("left", "cup", 0.5, (-0.5, 2, 0)), ("right", "cup", 0.5, (0.5, 2, 0)),
        ("board", None, 1, (0, 4, 0)),
    )  # fmt: skip
    folder = tmp_path / "out"
    write_views([view], folder)
    semantic = masks(
        folder, "semantic_segmentation", document(folder, "semantic_segmentation_labels")
    )
    shown = view.view.buffers.instance
    assert (semantic['{"class": "cup"}'] == ((shown == 0) | (shown == 1))).all()
    assert (semantic['{"class": "BACKGROUND"}'] == (shown < 0)).all()
    assert (semantic['{"class": "UNLABELLED"}'] == (shown == 2)).all()
    mapping = document(folder, "instance_segmentation_mapping")
    instances = masks(folder, "instance_segmentation", mapping)
    assert (instances['"/0/left"'] == (shown == 0)).all()
    assert (instances['"/1/right"'] == (shown == 1)).all()
    semantics = document(folder, "instance_segmentation_semantics_mapping")
    assert semantics.keys() == mapping.keys()
    assert [v["class"] for v in semantics.values()].count("cup") == 2
    assert len({color(n) for n in range(5000)}) == 5000


def test_depth_is_planar_and_along_the_ray(tmp_path):
    write_png(tmp_path / "final.png", np.full((100, 100, 3), 7, np.uint8))
    folder = tmp_path / "out"
    made = write_views([two_plates(0.25, folder=tmp_path), two_plates(0, folder=Path("x"))], folder)
    assert (made.images, made.annotations) == (2, 4)
    assert "no rgb of 1 of 2 frames" in made.losses[1]
    assert (folder / "rgb_0000.png").is_file()
    assert not (folder / "rgb_0001.png").exists()
    planar, along = (
        np.load(folder / f"distance_to_{n}_0000.npy") for n in ("image_plane", "camera")
    )
    assert planar.dtype == along.dtype == np.float32
    assert planar[30, 30] == pytest.approx(2)
    x = y = (30.5 - 50) / 100
    assert along[30, 30] == pytest.approx(2 * np.sqrt(1 + x * x + y * y))
    assert np.isinf(planar[0, 0])
    assert np.isinf(along[0, 0])
    assert (along >= planar).all()
    camera = document(folder, "camera_params")
    assert camera["cameraAperture"][0] == pytest.approx(camera["cameraFocalLength"])  # f = width
    point = np.array([0.5, 2.0, 0.25, 1.0]) @ np.reshape(camera["cameraViewTransform"], (4, 4))
    assert point == pytest.approx([0.5, 0.25, -2.0, 1.0])  # x right, y up, looking along -z
