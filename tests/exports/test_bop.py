"""BOP's folders, read by another hand: poses, models, masks, depth and the official counts."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from exports.made_views import made_view, two_plates
from readouts.level_view import CUBE, FACES, LEVEL, about_z

from legoworld.errors import UsageError
from legoworld.exports.bop import visible_bop19, write_views
from legoworld.exports.bop_models import diameter

CUBES = (CUBE, FACES)


def write(tmp_path, *views):
    made = write_views(views, tmp_path / "bop")
    return made, tmp_path / "bop"


def table(folder, name, scene=1):
    return json.loads((folder / "test" / f"{scene:06d}" / f"scene_{name}.json").read_text())


def picture(folder, name, scene=1):
    return cv2.imread(str(folder / "test" / f"{scene:06d}" / name), cv2.IMREAD_UNCHANGED)


def square(values, n):
    return np.array(values, float).reshape(n, -1)


@pytest.mark.parametrize(
    ("moved", "a", "b"),
    [(0.0, (2500, 0, 2500), (2500, 2500, 2500)),
     (0.25, (2500, 1250, 2500), (2500, 2500, 2500)),
     (0.5, (2500, 2500, 2500), (1250, 1250, 2500))],
)  # fmt: skip
def test_plates_are_counted_as_bop_counts_and_exactly(tmp_path, moved, a, b):
    _, folder = write(tmp_path, two_plates(moved))
    for info, (inside, visible, whole) in zip(table(folder, "gt_info")["0"], (a, b), strict=True):
        assert info["px_count_all"] == whole
        assert info["px_count_valid"] == inside
        assert info["px_count_visib"] == visible
        assert info["visib_fract"] == visible / whole
        exact = info["exact"]
        assert (exact["in_frame_px"], exact["visible_px"], exact["whole_px"]) == (
            inside, visible, whole
        )  # fmt: skip
    if moved == 0.5:  # BOP's boxes are one less than their columns and rows, and leave the frame
        assert table(folder, "gt_info")["0"][1]["bbox_obj"] == [75, 25, 49, 49]
        assert table(folder, "gt_info")["0"][1]["bbox_visib"] == [75, 25, 24, 49]


def test_what_bop_calls_visible_is_hidden_ten_millimetres_behind_a_sheet(tmp_path):
    measured = np.array([0, 500, 500, 900], np.float32)
    model = np.array([510, 510, 520, 900], np.float32)
    assert visible_bop19(measured, model).tolist() == [True, True, False, True]
    view = made_view(("wall", "wall", 0.5, (0, 2.01, 0)), ("paper", "paper", 1, (0, 2, 0)))
    _, folder = write(tmp_path, view)
    hidden = table(folder, "gt_info")["0"][0]
    assert hidden["px_count_visib"] == hidden["px_count_all"] > 0
    assert hidden["exact"]["visible_px"] == 0
    assert picture(folder, "mask_visib/000000_000000.png").any()
    assert not picture(folder, "mask_visib_exact/000000_000000.png").any()


def test_models_in_their_poses_are_the_scene(tmp_path):
    placed = [
        ("first", "box", about_z(30) * 0.5, (-1.0, 4.0, 0.2)),
        ("second", "box", about_z(-75) * 0.5, (1.0, 5.0, 0.0)),
        ("larger", "box", about_z(10) * 0.8, (0.0, 7.0, -0.5)),
        ("mirrored", "tray", np.diag([-0.5, 0.5, 0.5]), (0.0, 3.0, 1.0)),
        ("unlabelled", None, 1, (0.0, 9.0, 0.0)),
    ]
    _, folder = write(tmp_path, made_view(*placed, shape=CUBES, unit_scale=0.1))
    poses, camera = table(folder, "gt")["0"], table(folder, "camera")["0"]
    assert [(p["name"], p["category"]) for p in poses] == [(n, c) for n, c, _, _ in placed[:4]]
    ids = [pose["obj_id"] for pose in poses]
    assert ids[0] == ids[1]
    assert len(set(ids)) == 3  # a mirrored part is a shape of its own, a larger one too
    cam_from_world = np.column_stack(
        [square(camera["cam_R_w2c"], 3), camera["cam_t_w2c"]]
    )  # millimetres
    k = square(camera["cam_K"], 3)
    info = json.loads((folder / "models" / "models_info.json").read_text())
    for n, (pose, (_, _, linear, place)) in enumerate(zip(poses, placed[:4], strict=True)):
        model = trimesh.load(folder / "models" / f"obj_{pose['obj_id']:06d}.ply", process=False)
        rotation = square(pose["cam_R_m2c"], 3)
        assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        ours = model.vertices @ rotation.T + pose["cam_t_m2c"]
        world_mm = (CUBE @ np.asarray(linear).T + place) * 100
        truth = world_mm @ cam_from_world[:, :3].T + cam_from_world[:, 3]
        apart = np.linalg.norm(ours[:, None] - truth, axis=2).min(axis=1)
        assert apart.max() < 1e-3  # so MSSD and MSPD of the truth are 0
        described = info[str(pose["obj_id"])]
        assert np.allclose(model.extents, [described[f"size_{a}"] for a in "xyz"], rtol=1e-6)
        assert np.allclose(model.bounds[0], [described[f"min_{a}"] for a in "xyz"], atol=1e-4)
        assert described["diameter"] == pytest.approx(np.linalg.norm(model.extents), rel=1e-6)
        mask = picture(folder, f"mask/000000_{n:06d}.png") > 0
        shown = ours @ k.T
        u, v = (shown[:, :2] / shown[:, 2:]).T  # the centre of the first pixel is 0
        rows, columns = np.nonzero(mask)
        low, high = (u.min(), v.min()), (u.max(), v.max())
        assert np.allclose([columns.min(), rows.min()], np.maximum(low, 0), atol=1)
        assert np.allclose([columns.max(), rows.max()], np.minimum(high, 99), atol=1)


def test_depth_masks_and_targets(tmp_path):
    made, folder = write(
        tmp_path,
        two_plates(0.25, scene="a"),
        made_view(("far", "wall", 30, (0, 20, 0)), scene="b"),
        made_view(("near", "wall", 1, (0, 2, 0)), scene="b"),
    )
    assert (made.images, made.annotations) == (3, 4)
    assert "depth is rounded to 0.5 mm" in made.losses
    depth = picture(folder, "depth/000000.png")
    assert depth.dtype == np.uint16
    assert table(folder, "camera")["0"]["depth_scale"] == 0.1
    assert depth[50, 30] * 0.1 == pytest.approx(2000, abs=0.05)
    assert depth[50, 60] * 0.1 == pytest.approx(1000, abs=0.05)
    assert depth[0, 0] == 0
    assert picture(folder, "depth/000000.png", 2)[50, 50] * 0.5 == pytest.approx(20000)
    mask, visible = (picture(folder, f"{m}/000000_000000.png") for m in ("mask", "mask_visib"))
    assert set(np.unique(mask)) == {0, 255}
    assert (visible <= mask).all()
    targets = json.loads((folder / "test_targets_bop19.json").read_text())
    assert [(t["scene_id"], t["im_id"], t["inst_count"]) for t in targets] == [
        (1, 0, 1), (1, 0, 1), (2, 0, 1), (2, 1, 1),
    ]  # fmt: skip
    sensor = json.loads((folder / "camera.json").read_text())
    assert (sensor["width"], sensor["height"], sensor["cx"], sensor["fx"]) == (100, 100, 49.5, 100)


def test_an_orthographic_camera_is_refused(tmp_path):
    flat = replace(LEVEL, type="ORTHO", ortho_scale=4.0)
    with pytest.raises(UsageError, match="BOP cannot hold an orthographic camera"):
        write(tmp_path, two_plates(0, camera=flat))


def test_the_diameter_is_that_of_all_pairs():
    points = np.random.default_rng(5).normal(size=(700, 3)) * [5, 1, 0.01]
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    assert diameter(points) == pytest.approx(apart.max(), rel=1e-12)
    assert diameter(points[:1]) == 0
