"""Normals fitted to depth: exact on planes, and a run of any depth."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from evaluation.normals.folders import evaluate, wall, write_truth

from legoworld import cli
from legoworld.baselines.depth_normals import _FEWEST, fitted_normals
from legoworld.readouts.depth import write_depth
from legoworld.visibility.projection import Projection

SIZE = (24, 16)
CAMERA = (20.0, 25.0, 12.0, 7.0)


def rays(intrinsics=CAMERA, size_wh=SIZE):
    fx, fy, cx, cy = intrinsics
    y, x = np.mgrid[: size_wh[1], : size_wh[0]] + 0.5
    return np.stack([(x - cx) / fx, (y - cy) / fy, np.ones(size_wh[::-1])], axis=-1)


def plane_z(normal, distance=3.0):
    """Depth of the plane n . X = -distance, where it is in front of the camera."""
    with np.errstate(divide="ignore"):
        z = -distance / (rays() @ np.asarray(normal, float))
    return np.where(z > 0, z, np.nan)


@pytest.mark.parametrize(
    "normal", [(0, 0, -1), (0, -1, 0), (0.6, 0, -0.8), (-0.48, 0.6, -0.64), (0.9, 0, 0.1)]
)
def test_a_plane_has_its_own_normal_everywhere(normal):
    found = fitted_normals(1 / plane_z(normal), CAMERA)
    unit = np.asarray(normal) / np.linalg.norm(normal)
    known = np.isfinite(found[..., 0])
    assert known.sum() > 0.4 * np.isfinite(plane_z(normal)).sum() > 30
    assert found[known] == pytest.approx(np.tile(unit, (known.sum(), 1)), abs=2e-6)


def test_an_edge_between_two_surfaces_is_not_smoothed():
    near, far = plane_z((0, 0, -1), 1.0), plane_z((0.28, 0, -0.96), 9.0)
    z = np.where(np.arange(SIZE[0]) < 12, near, far)
    found = fitted_normals(1 / z, CAMERA)
    assert np.allclose(found[:, :12], [0, 0, -1], atol=1e-6)
    known = np.isfinite(found[:, 12:, 0])
    assert known.mean() > 0.9
    assert np.allclose(found[:, 12:][known], [0.28, 0, -0.96], atol=1e-5)


def test_holes_single_pixels_and_lines_have_no_normal():
    z = np.full(SIZE[::-1], np.nan)
    z[2, 3] = 1.0
    z[8] = 2.0
    assert np.isnan(fitted_normals(1 / z, CAMERA)).all()


def call(*words):
    return cli.run([str(word) for word in words])


@pytest.fixture
def track(tmp_path):
    (tmp_path / "photos").mkdir()
    cv2.imwrite(str(tmp_path / "photos/a.png"), np.zeros((*SIZE[::-1], 3), np.uint8))
    write_truth(tmp_path / "truth", {"a.png": wall(SIZE, 20)})
    words = ["--truth", tmp_path / "truth", "--photos", tmp_path / "photos"]
    path = tmp_path / "track.json"
    assert call("track", "make", "--task", "normals", *words, "-o", path) == 0
    (tmp_path / "camera.json").write_text(
        json.dumps(dict(zip(("fx", "fy", "cx", "cy"), CAMERA, strict=True)))
    )
    return path


def slanted_plane():
    return plane_z((np.sin(np.radians(20)), 0, -np.cos(np.radians(20)))).astype(np.float32)


def bring(track: Path, folder: Path, run: Path, *more: object) -> int:
    return call(
        "baseline", "import", folder, "--task", "normals", "--track", track, "-o", run, *more
    )


@pytest.mark.parametrize(
    ("space", "of_z"),
    [
        ("depth", lambda z: z),
        ("disparity", lambda z: 7 / z),
        ("ray_distance", lambda z: z * np.linalg.norm(rays(), axis=-1)),
    ],
)
def test_a_depth_of_any_space_has_a_row_of_normals(space, of_z, track, tmp_path):
    (tmp_path / "theirs").mkdir()
    np.save(tmp_path / "theirs/a_depth.npy", of_z(slanted_plane()).astype(np.float32))
    words = ["--space", space, "--intrinsics", tmp_path / "camera.json"]
    assert bring(track, tmp_path / "theirs", tmp_path / "run", *words) == 0
    summary = evaluate(tmp_path / "run", tmp_path / "truth", tmp_path / "evaluation")
    assert summary.pooled["mean_deg"]["error_90"] < 0.01
    configuration = json.loads((tmp_path / "run/run.json").read_text())["configuration"]
    assert configuration["imported"]["space"] == space
    assert configuration["imported"]["cameras_sha256"]


def test_a_disparity_of_zero_or_less_is_no_surface(track, tmp_path):
    """What is infinitely far has no normal; its neighbours keep theirs."""
    (tmp_path / "theirs").mkdir()
    disparity = (7 / slanted_plane()).astype(np.float32)
    disparity[:, :12] = 0.0
    disparity[:, :4] = -1.0
    np.save(tmp_path / "theirs/a.npy", disparity)
    words = ["--space", "disparity", "--intrinsics", tmp_path / "camera.json"]
    assert bring(track, tmp_path / "theirs", tmp_path / "run", *words) == 0
    (written,) = (tmp_path / "run").glob("normals/*.npz")
    fitted = np.isfinite(np.load(written)["values"]).all(axis=-1)
    assert not fitted[:, :12].any()
    assert fitted[:, 12:].all()


def test_a_readouts_depth_knows_its_own_camera(track, tmp_path):
    fx, fy, cx, cy = CAMERA
    camera = Projection(orthographic=False, fx=fx, fy=fy, cx=cx, cy=cy, z_near=0.1, z_far=100.0)
    (tmp_path / "depth").mkdir()
    write_depth(tmp_path / "depth/a.npz", slanted_plane(), camera)
    assert bring(track, tmp_path / "depth", tmp_path / "run", "--space", "depth") == 0
    summary = evaluate(tmp_path / "run", tmp_path / "truth", tmp_path / "evaluation")
    assert summary.pooled["mean_deg"]["error_90"] < 0.01


def test_depth_without_a_camera_or_with_a_sign_is_refused(track, tmp_path, capsys):
    (tmp_path / "theirs").mkdir()
    np.save(tmp_path / "theirs/a.npy", slanted_plane())
    run = tmp_path / "run"
    assert bring(track, tmp_path / "theirs", run, "--space", "depth") == 2
    assert "has no intrinsics, without which a depth has no normals" in capsys.readouterr().err
    words = ["--space", "depth", "--sign", "towards_camera"]
    assert bring(track, tmp_path / "theirs", run, *words) == 2
    assert "point towards the camera" in capsys.readouterr().err
    assert bring(track, tmp_path / "theirs", run, "--unit", "m") == 2
    assert "--unit is for depth that normals are fitted to" in capsys.readouterr().err


@pytest.mark.parametrize(("known", "fitted"), [(_FEWEST, True), (_FEWEST - 1, False)])
def test_a_pixel_needs_so_many_of_its_surface(known, fitted):
    """The centre and its nearest neighbours, not all in one line."""
    z = np.full(SIZE[::-1], np.nan)
    window = [(dy, dx) for dy in range(-2, 3) for dx in range(-2, 3)]
    order = sorted(window, key=lambda o: (o[0] ** 2 + o[1] ** 2, o))
    for dy, dx in order[:known]:
        z[8 + dy, 10 + dx] = 2.0
    assert np.isfinite(fitted_normals(1 / z, CAMERA)[8, 10]).all() == fitted
