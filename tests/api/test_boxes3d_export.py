"""Boxes in space in Omni3D's and KITTI's words: what their readers make of the files."""

import json
import re

import numpy as np
import pytest
from evaluation.commands import evaluate
from evaluation.detection_runs import write_run
from evaluation.solids import about_y, box

from legoworld import cli

CAMERA = {
    "orthographic": False, "fx": 100.0, "fy": 110.0, "cx": 50.0, "cy": 40.0,
    "z_near": 0.1, "z_far": 100.0,
}  # fmt: skip
BOXES = [
    box((0.5, 0.2, 6), (2, 1, 0.5), about_y(30)),
    box((-1, 0, 9), (1, 1.5, 0.7), about_y(-70)),
    box((2.6, 0, 5), (1, 1, 1)),
]
SHARES = [(0.0, 1.0), (0.0, 0.6), (0.4, 0.2)]


@pytest.fixture
def run(tmp_path):
    """A run of one image whose scene was seen by CAMERA."""
    truth = {
        "images": [{"id": 4, "file_name": "street/a.jpg", "width": 100, "height": 80}],
        "categories": [{"id": 1, "name": "car"}, {"id": 2, "name": "traffic light"}],
    }
    predictions = [
        {"image_id": 4, "category_id": k % 2 + 1, "score": 1.0, "bbox3D": b.tolist(),
         "truncation": cut, "visibility": seen}
        for k, (b, (cut, seen)) in enumerate(zip(BOXES, SHARES, strict=True))
    ]  # fmt: skip
    folder = write_run(tmp_path / "run", "boxes3d", truth, predictions)
    (tmp_path / "track.json").write_text(json.dumps({**truth, "info": {}}))
    document = json.loads((folder / "run.json").read_text())
    more = {"schema_version": 1, "finished_at": "", "versions": {}}
    scenes = {"4": {"scene": "a", "projection": CAMERA}}
    (folder / "run.json").write_text(json.dumps({**document, **more, "scenes": scenes}))
    return folder


def export(run, output, form):
    words = ["export", run, "--format", form, "--track", run.parent / "track.json", "-o", output]
    return cli.run([str(w) for w in words])


def test_omni3d_s_file_is_ground_truth_for_its_own_run(run, tmp_path):
    assert export(run, tmp_path / "truth.json", "omni3d") == 0
    document = json.loads((tmp_path / "truth.json").read_text())
    assert document["images"][0]["K"] == [[100, 0, 50], [0, 110, 40], [0, 0, 1]]
    first, _, cut = document["annotations"]
    assert np.array_equal(first["bbox3D_cam"], BOXES[0])
    assert first["dimensions"] == pytest.approx([0.5, 1, 2])  # width, height, length
    assert np.array(first["R_cam"]) == pytest.approx(about_y(30))
    rebuilt = box(first["center_cam"], np.array(first["dimensions"])[[2, 1, 0]], first["R_cam"])
    assert rebuilt == pytest.approx(BOXES[0])
    assert (cut["truncation"], cut["visibility"]) == SHARES[2]
    x0, _, x1, _ = cut["bbox2D_proj"]
    assert x0 < 100 < x1
    assert cut["bbox2D_trunc"][2] == 100
    assert evaluate(run, tmp_path / "truth.json", tmp_path / "eval") == 0
    summary = json.loads((tmp_path / "eval" / "summary.json").read_text())
    assert summary["metrics"]["AP"] == pytest.approx(1)
    assert summary["counts"]["truth_ignored"] == 1


def test_kitti_s_columns_place_the_box_where_it_was(run, tmp_path):
    assert export(run, tmp_path / "kitti", "kitti") == 0
    lines = (tmp_path / "kitti/label_2/a.txt").read_text().splitlines()
    occluded = []
    for line, corners in zip(lines, BOXES, strict=True):
        kind, *columns = line.split(" ")
        assert kind in ("car", "traffic_light")
        assert len(columns) == 14
        truncated, hidden, alpha, x0, y0, x1, y1, h, w, length, x, y, z, ry = map(float, columns)
        occluded.append((truncated, hidden))
        # As the development kit builds it: the bottom's centre, turned about the camera's y.
        rebuilt = box((x, y - h / 2, z), (length, h, w), about_y(np.degrees(ry)))
        nearest = np.abs(rebuilt[:, None] - corners).sum(2).min(1)
        assert nearest.max() < 1e-5
        assert np.isclose((alpha - ry + np.arctan2(x, z) + np.pi) % (2 * np.pi), np.pi, atol=1e-5)
        u = 100 * corners[:, 0] / corners[:, 2] + 50
        assert (x0, x1) == pytest.approx((max(u.min(), 0), min(u.max(), 100)), abs=1e-4)
        assert 0 <= y0 < y1 <= 80
    assert occluded == [(0, 0), (0, 1), (0.4, 2)]
    calib = (tmp_path / "kitti/calib/a.txt").read_text().split("\n")
    assert [float(v) for v in calib[2].split()[1:6]] == [100, 0, 50, 0, 0]


@pytest.mark.parametrize(
    ("form", "said"),
    [("coco", "boxes in space.*--format omni3d"), ("kins", "no amodal masks")],
)
def test_forms_without_a_place_for_them_are_refused(form, said, run, tmp_path, capsys):
    assert export(run, tmp_path / "out.json", form) == 2

    assert re.search(said, capsys.readouterr().err)
    assert not (tmp_path / "out.json").exists()


def test_a_run_without_cameras_and_existing_output_are_refused(run, tmp_path, capsys):
    (tmp_path / "there.json").write_text("")
    assert export(run, tmp_path / "there.json", "omni3d") == 2
    document = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({**document, "scenes": {}}))
    assert export(run, tmp_path / "new.json", "omni3d") != 0
    assert "image 4 of the run has no camera matrix" in capsys.readouterr().err
