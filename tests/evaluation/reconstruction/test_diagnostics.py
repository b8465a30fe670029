"""The numbers beside R: registration, alignments, voxels, chamfer, and a camera of one's own."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from evaluation.reconstruction.datasets import (
    Submission,
    evaluate_bench,
    small_raster,
    write_dataset,
    write_run,
)

from legoworld.evaluation.reconstruction import aligned
from legoworld.evaluation.reconstruction.aligned import (
    angle_rad,
    disparity_fitted,
    median_scaled,
    trimmed_icp,
)
from legoworld.evaluation.reconstruction.fscore import (
    chamfer_over_diagonal,
    match_surfaces,
    voxel_ious,
)
from legoworld.evaluation.reconstruction.integrity import correlation
from legoworld.evaluation.reconstruction.nearest import share_raster
from legoworld.evaluation.reconstruction.points import finite_points, points_m

RANDOM = np.random.default_rng(7)
#: A lumpy cloud 3 m ahead, away from the origin in every direction.
CLOUD = RANDOM.uniform([-1, 0, 2], [1, 1.5, 4], (900, 3))


def turned(degrees, axis):
    axis, a = np.array(axis, np.float64), math.radians(degrees)
    axis /= np.linalg.norm(axis)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + math.sin(a) * k + (1 - math.cos(a)) * k @ k


def test_the_same_cloud_needs_one_step_and_no_motion():
    found = trimmed_icp(CLOUD, CLOUD)
    registration = found.registration
    assert registration.iterations == 1
    assert registration.trimmed_rms_m == 0
    assert registration.rotation_deg == pytest.approx(0, abs=1e-5)
    assert registration.translation_m == pytest.approx(0, abs=1e-12)


def test_a_small_motion_is_found():
    rotation, shift = turned(2.0, (1, 2, 3)), np.array([0.02, -0.01, 0.03])
    submitted = (CLOUD - shift) @ rotation  # reference = rotation @ submitted + shift
    found = trimmed_icp(CLOUD, submitted)
    assert found.apply(submitted) == pytest.approx(CLOUD, abs=1e-4)
    assert found.rotation == pytest.approx(rotation, abs=1e-4)
    assert found.registration.rotation_deg == pytest.approx(2.0, abs=1e-2)
    assert found.registration.translation_m == pytest.approx(np.linalg.norm(shift), abs=1e-3)
    assert 1 < found.registration.iterations <= aligned.ICP_ITERATIONS


def test_a_fifth_of_the_points_may_be_something_else():
    other = CLOUD.copy()
    other[::6] += [0, 5, 0]
    found = trimmed_icp(CLOUD, other)
    assert found.registration.iterations == 1
    assert found.registration.trimmed_rms_m == 0
    assert found.registration.translation_m == pytest.approx(0, abs=1e-12)


def test_three_points_are_enough_and_two_are_not():
    assert trimmed_icp(CLOUD[:3], CLOUD[:3]) is not None
    assert trimmed_icp(CLOUD[:2], CLOUD) is None
    assert trimmed_icp(CLOUD, CLOUD[:2]) is None


def test_large_clouds_are_thinned_evenly(monkeypatch):
    monkeypatch.setattr(aligned, "ICP_POINTS", 400)
    assert aligned._thin_points(CLOUD).tolist() == CLOUD[::3].tolist()
    monkeypatch.setattr(aligned, "ICP_POINTS", 450)
    assert aligned._thin_points(CLOUD).tolist() == CLOUD[::2].tolist()
    monkeypatch.setattr(aligned, "ICP_POINTS", 900)
    assert aligned._thin_points(CLOUD).tolist() == CLOUD.tolist()


def test_a_mirror_image_is_met_by_a_rotation():
    rotation, _ = aligned._kabsch(CLOUD, CLOUD * [-1, 1, 1])
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("degrees", [0.0, 1e-7, 0.5, 60.0, 120.0, 179.999])
def test_the_angle_of_a_rotation(degrees):
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (3, -2, 1)):
        assert math.degrees(angle_rad(turned(degrees, axis))) == pytest.approx(
            degrees, rel=1e-6, abs=1e-12
        )


def test_scaled_by_the_median_ratio():
    reference = np.float32([[1.0, 2.0, 9.0], [4.0, np.inf, 1.0]])
    submitted = np.float32([[2.0, 4.0, 3.0], [8.0, 5.0, np.inf]])
    both = np.isfinite(reference) & np.isfinite(submitted)
    found = median_scaled(reference, submitted, both)  # ratios .5, .5, 3, .5
    assert found.tolist() == [[1.0, 2.0, 1.5], [4.0, 2.5, np.inf]]
    assert median_scaled(reference, submitted, np.zeros_like(both)) is None


def test_fitted_in_disparity():
    x = np.float64([0.2, 0.4, 0.5, 0.8, 0.1])
    reference, submitted = np.float32([1 / (2 * x - 0.3)]), np.float32([1 / x])
    both = np.array([[True, True, True, True, False]])  # 2 * .1 - .3 is not positive
    found = disparity_fitted(reference, submitted, both)
    assert found.dtype == np.float32
    assert found[0, :4] == pytest.approx(reference[0, :4], rel=1e-5)
    assert found[0, 4] == np.inf
    for some in ([True, False, False, False, False], [False] * 5):
        assert disparity_fitted(reference, submitted, np.array([some])) is None
    assert disparity_fitted(reference, np.full_like(submitted, 3.0), both) is None
    two = np.array([[True, True, False, False, False]])
    assert disparity_fitted(reference, submitted, two)[0, :2] == pytest.approx(
        reference[0, :2], rel=1e-5
    )


def test_voxels_are_counted_once_and_anchored_at_the_camera():
    def iou(ours, theirs, edge):
        return voxel_ious(ours, theirs, [edge])[0]

    cells = np.array([[0.01, 0.01, 0.01], [0.02, 0.03, 0.04], [-0.01, 0.01, 0.01], [0.01, 0.06, 0]])
    assert iou(cells, cells, 0.05) == 1.0
    assert iou(cells, cells[:2], 0.05) == 1 / 3  # two points, one voxel
    assert iou(cells, cells[:2], 0.1) == 1 / 2
    assert iou(cells[:1], cells[2:3], 0.05) == 0.0  # on two sides of a border
    none = np.empty((0, 3))
    assert iou(cells, none, 0.05) == 0.0
    assert iou(none, none, 0.05) is None
    far = np.array([[1e9, 0.0, 0.0], [2e9, 0.0, 0.0], [-1e9, 0.0, 0.0], [0.0, 0.0, 1e9]])
    assert iou(far, far[:1], 0.05) == 1 / 3  # what lies beyond is in the outermost one
    # The outermost voxel ends before the next row begins.
    for k in (1, 2):
        top, next_row = np.zeros((1, 3)), np.zeros((1, 3))
        top[0, k], next_row[0, k - 1], next_row[0, k] = 1e9, 0.06, (-(1 << 20) + 1.5) * 0.05
        assert iou(top, next_row, 0.05) == 0.0
    one = np.array([[0.0, 0.0, 0.0]])
    for axis in range(3):
        assert iou(one, one + 0.05 * np.eye(3)[axis], 0.05) == 0.0


@pytest.mark.parametrize("scale_m", [0.3, 30.0])
def test_voxels_at_several_edges_are_those_of_sets(scale_m):
    """Some hundred voxels, and more of them than a small table holds."""
    ours, theirs = np.random.default_rng(5).normal(size=(2, 20_000, 3)) * scale_m
    theirs[:9_000] = ours[:9_000]
    edges = (0.05, 0.1, 0.07)
    for edge, found in zip(edges, voxel_ious(ours, theirs, edges), strict=True):
        a, b = (set(map(tuple, np.floor(cloud / edge).tolist())) for cloud in (ours, theirs))
        assert found == len(a & b) / len(a | b)


def test_chamfer_over_the_diagonal():
    raster = small_raster()
    depth = np.full((raster.height, raster.width), 2.0, np.float32)
    label = np.zeros(depth.shape, np.int32)
    nearer = depth * np.float32(0.9)
    pairs = match_surfaces(*share_raster(depth, nearer, label, raster))
    points = points_m(depth, raster)[finite_points(depth)]
    both = np.mean(pairs.reference_distance_m) + np.mean(pairs.submitted_distance_m)
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    assert chamfer_over_diagonal(pairs, points) == pytest.approx(both / 2 / diagonal, rel=1e-12)
    assert both / 2 == pytest.approx(0.2, rel=0.05)
    assert chamfer_over_diagonal(pairs, points[:1]) is None
    nothing = match_surfaces(*share_raster(depth, np.full_like(depth, np.inf), label, raster))
    assert chamfer_over_diagonal(nothing, points) is None


def test_a_camera_of_ones_own(tmp_path):
    """The surface as the submission's own intrinsics show it is scored beside R."""
    dataset = write_dataset(tmp_path / "bench", families=1, tiers=("easy",), views=4)
    raster = small_raster()
    same = [raster.fx, raster.fy, raster.cx, raster.cy]
    own = {
        1: same,
        2: [raster.fx, raster.fy, raster.cx + 9, raster.cy],
        3: [raster.fx, raster.fy, raster.cx, raster.cy + 9],
        4: [raster.fx * 1.3, raster.fy, raster.cx, raster.cy],
    }
    run = write_run(
        tmp_path / "run", dataset,
        {i: Submission(extra={"own_depth_z_m": dataset.cases[i].depth_z_m,
                              "own_intrinsics_px": np.array(values)})
         for i, values in own.items()},
    )  # fmt: skip
    evaluate_bench(run, dataset.private, tmp_path / "eval", draws=2)
    lines = (tmp_path / "eval" / "per_image.jsonl").read_text().splitlines()
    rows = {row["image_id"]: row for row in map(json.loads, lines)}
    assert {row["status"] for row in rows.values()} == {"ok"}
    found = {i: row["diagnostics"]["R_own_intrinsics"] for i, row in rows.items()}
    assert found[1] == rows[1]["R"] == 1.0
    for i in (2, 3, 4):
        assert rows[i]["R"] == 1.0
        assert found[i] < 0.95


def test_the_correlation_of_pictures_mirrored_or_not():
    picture = RANDOM.integers(0, 256, (4, 6, 3)).astype(np.uint8)
    for same in (picture, picture[:, ::-1], picture[::-1], picture[::-1, ::-1]):
        assert correlation(same, picture) == pytest.approx(1.0, rel=1e-12)
    assert correlation((picture // 2 + 9).astype(np.uint8), picture) > 0.99
    other = picture.copy()
    other[:2] = RANDOM.integers(0, 256, (2, 6, 3))
    directions = (other, other[:, ::-1], other[::-1], other[::-1, ::-1])
    expected = max(np.corrcoef(o.ravel(), picture.ravel())[0, 1] for o in directions)
    assert expected > 0.3
    assert correlation(other, picture) == pytest.approx(expected, rel=1e-12)
    flat = np.full_like(picture, 7)
    assert correlation(flat, picture) == correlation(picture, flat) == 0.0
    step = np.zeros((1, 2, 3), np.uint8)
    step[:, 0] = 255
    assert correlation(step, 255 - step) == pytest.approx(1.0)  # mirrored
    gradient = np.uint8([[[0] * 3, [10] * 3, [0] * 3]])
    assert correlation(gradient, 255 - gradient) == 0.0  # below nothing counts as nothing


@pytest.mark.parametrize("decimals", [1, 12])
def test_pairs_of_a_moving_cloud_are_those_of_a_fresh_tree(decimals):
    """Kept pairs, too; with one decimal many targets are equally near: distances decide."""
    random = np.random.default_rng(decimals)
    target, moving = np.round(random.normal(size=(2, 300, 3)), decimals)
    pairs = aligned.MovingPairs(target)
    for step in range(8):
        distance, place = pairs.query(moving)
        apart = np.linalg.norm(moving[:, None] - target[None], axis=-1)
        np.testing.assert_allclose(distance, apart.min(axis=1), rtol=1e-12)
        np.testing.assert_allclose(
            distance, np.linalg.norm(moving - target[place], axis=-1), rtol=1e-12
        )
        moving = moving + random.normal(size=3) * 0.3**step
