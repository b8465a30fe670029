"""Any file, any camera: views of one scene, aligned row by row."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pycocotools.coco import COCO

import legoworld
from legoworld import cli
from legoworld.errors import NoCameraError, SceneMissingError, UsageError
from legoworld.visibility.lens import Lens

ROOT = Path(__file__).parents[2]
COFFEE = ROOT / "examples" / "coffee"
SIZE = (64, 48)

SCENES = """
    import math
    fresh()
    quad("Near", category="chair", z=0.0)
    quad("Far", category="tv", z=-3.0, size=6.0)
    quad("Rock", z=-1.0, size=0.3)
    extra = []
    for n in range(10):
        data = bpy.data.cameras.new(f"View {n}")
        holder = bpy.data.objects.new(f"View {n}", data)
        holder.location = (0.3 * n - 1.4, 0.2 * (n % 3), 5.0 + 0.5 * n)
        holder.rotation_euler = (0.05 * n - 0.2, 0.08 * n - 0.3, 0.6 * n)
        data.lens, data.shift_x, data.shift_y = 20 + 6 * n, 0.03 * n, -0.02 * n
        data.sensor_fit = ("AUTO", "HORIZONTAL", "VERTICAL")[n % 3]
        if n == 4:
            data.type, data.ortho_scale = "ORTHO", 5.0
        if n == 9:
            data.type = "PANO"
        bpy.context.scene.collection.objects.link(holder)
        extra.append(holder)
    extra[8].hide_render = True
    for n in range(8):
        bpy.context.scene.camera = extra[n]
        bpy.ops.wm.save_as_mainfile(filepath=f"{OUT}/active {n}.blend", copy=True)
    bpy.ops.wm.save_as_mainfile(filepath=f"{OUT}/kitchen.blend", copy=True)
    glb = f"{OUT}/kitchen.glb"
    bpy.ops.export_scene.gltf(filepath=glb, export_extras=True, export_cameras=True)
    bpy.context.scene.camera = None
    for holder in extra:
        bpy.data.objects.remove(holder)
    for holder in [o for o in bpy.data.objects if o.type == "CAMERA"]:
        bpy.data.objects.remove(holder)
    bpy.ops.wm.save_as_mainfile(filepath=f"{OUT}/nobody.blend", copy=True)
"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def kitchen(scenes, cache):
    return legoworld.open_scene(scenes / "kitchen.blend", cache=cache)


@pytest.fixture(scope="module")
def coffee():
    return legoworld.open_scene(COFFEE)


def describe_view(view):
    """All that a view says, but for the name of its file."""
    return (
        view.instance.tobytes(),
        view.depth_z_m.tobytes(),
        view.normals().tobytes(),
        view.predictions(),
        view.masks().tobytes(),
        view.amodal_masks().tobytes(),
        view.to_dict()["instances"],
    )


def test_a_files_cameras_are_those_of_files_with_each_as_the_active_one(kitchen, scenes, cache):
    assert list(kitchen.cameras) == ["View 7", *(f"View {n}" for n in range(7))]
    views = kitchen.views(kitchen.cameras, size_wh=SIZE, task="coco-masks", workers=2)
    seen = {view.camera.name: describe_view(view) for view in views}
    for n in range(8):
        scene = legoworld.open_scene(scenes / f"active {n}.blend", cache=cache)
        view = scene.view(task="coco-masks", size_wh=SIZE)
        assert view.camera.name == f"View {n}"
        assert describe_view(view) == seen[f"View {n}"]
    assert len({s[0] for s in seen.values()}) == 8
    with pytest.raises(UsageError, match=r"no camera 'View 8'.*hidden from rendering"):
        kitchen.view(camera="View 8")


def test_a_pose_is_the_camera_that_has_it(kitchen):
    active = kitchen.view(task="coco", size_wh=SIZE)
    known = {"size_wh": SIZE, "task": "coco"}
    clip = active.camera.clip_start, active.camera.clip_end
    for given in (
        {"cam_from_world": active.cam_from_world},
        {"world_from_cam": active.world_from_cam, "K": active.K, "clip": clip},
        {"world_from_cam": active.world_from_cam.tolist(), "K": np.float32(active.K)[None]},
    ):
        (view,) = kitchen.views(**given, **known)
        assert (view.instance == active.instance).mean() > 0.999
        seen = np.isfinite(view.depth_z_m) & np.isfinite(active.depth_z_m)
        assert np.median(np.abs(view.depth_z_m[seen] - active.depth_z_m[seen])) < 1e-5
        np.testing.assert_allclose(view.cam_from_world, active.cam_from_world, atol=1e-6)
        np.testing.assert_allclose(view.K, active.K, rtol=1e-6)
    assert active.cam_from_world @ active.world_from_cam == pytest.approx(np.eye(4), abs=1e-9)


def test_what_a_pose_means(kitchen):
    """Two units above the square of one unit around the origin, the picture's y along -y."""
    down = np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
    intrinsics = [[20, 0, 32], [0, 20, 24], [0, 0, 1]]
    given = {"cam_from_world": down, "K": intrinsics, "clip": (0.1, 2.5)}
    (view,) = kitchen.views(**given, size_wh=SIZE, task="coco")
    (near,) = view.labelled  # the other one is beyond the clip range
    assert (near.name, near.category, near.category_id) == ("Near", "chair", 62)
    assert near.bbox_xywh_px == (22, 14, 20, 20)  # 2 units wide: 20 px at a distance of 2
    assert view.depth_z_m[24, 32] == 2
    (flat,) = kitchen.views(cam_from_world=down, ortho_scale=64, size_wh=SIZE, task="coco")
    assert flat.labelled[0].bbox_xywh_px == (31, 23, 2, 2)  # a pixel is a unit
    (wide,) = kitchen.views(cam_from_world=down, fov_deg=90, size_wh=SIZE, task="coco")
    assert wide.K[0, 0] == pytest.approx(32)


def test_every_view_has_one_order(coffee):
    view = coffee.view(task="coco-masks", size_wh=(150, 100))
    rows, ids = view.labelled, view.category_ids()
    assert [r.category_id for r in rows] == ids.tolist() != sorted(ids.tolist(), reverse=True)
    assert [r.id for r in rows] == view.instance_ids().tolist() == sorted(r.id for r in rows)
    results = view.predictions(image_id=7)
    assert [p["category_id"] for p in results] == ids.tolist()
    assert [p["segmentation"] for p in results] == [
        {"size": list(r.size), "counts": r.counts} for r in view.rles()
    ]
    boxed = coffee.view(task="coco", size_wh=(150, 100))
    assert [p["bbox"] for p in boxed.predictions()] == boxed.boxes_xywh_px().tolist()
    target = view.targets(image_id=7)
    assert target["labels"].tolist() == ids.tolist()
    assert (target["masks"] == view.masks()).all()
    x0, y0, x1, y1 = target["boxes"].T
    assert np.stack([x0, y0, x1 - x0, y1 - y0], 1).tolist() == view.boxes_xywh_px().tolist()
    assert target["area"].tolist() == [r.area_px for r in rows]
    hf = view.targets("hf", image_id=7)
    assert [a["category_id"] for a in hf["annotations"]] == ids.tolist()
    assert [a["bbox"] for a in hf["annotations"]] == view.boxes_xywh_px().tolist()
    with pytest.raises(UsageError, match="category ids"):
        coffee.view(size_wh=(30, 20)).category_ids()


def test_tensors_are_those_arrays(coffee):
    torch = pytest.importorskip("torch", reason="torch is not installed")
    view = coffee.view(task="coco", size_wh=(60, 40))
    arrays, tensors = view.targets(), view.targets(arrays="torch")
    for name, array in arrays.items():
        if name != "image_id":
            assert isinstance(tensors[name], torch.Tensor)
            assert (tensors[name].numpy() == array).all()


def test_a_lens_that_bends_nothing_changes_no_pixel(coffee):
    plain = coffee.view(task="coco-masks", size_wh=(90, 60), camera="Camera")
    camera = next(iter(coffee.views(["Camera"], size_wh=(90, 60)).cameras))
    bent = coffee.view(task="coco-masks", camera=replace(camera, lens=Lens(coefficients=(0,) * 8)))
    assert describe_view(plain)[:5] == (
        bent.instance.tobytes(), bent.depth_z_m.tobytes(), bent.normals().tobytes(),
        bent.predictions(), bent.masks().tobytes(),
    )  # fmt: skip
    assert bent.valid.all()
    with pytest.raises(UsageError, match="distorting lens has no amodal"):
        bent.amodal_masks()


def test_a_lens_shows_what_its_ray_hits(coffee):
    """A fisheye of 180 degrees and more: each pixel is the pinhole's at its ray, or not valid."""
    camera = replace(
        coffee.views(["Camera"], size_wh=(90, 60)).cameras[0],
        fx=30.0, fy=30.0, cx=45.0, cy=30.0, lens=Lens(coefficients=(0,) * 8, fisheye=True),
    )  # fmt: skip
    view = coffee.view(task="coco", camera=camera)
    radius = np.hypot(*(np.indices((60, 90)) + 0.5 - np.array([30, 45])[:, None, None])) / 30
    assert not view.valid[radius > np.pi / 2].any()
    assert view.valid[radius < 1.2].all()
    assert (view.instance[~view.valid] == -1).all()
    assert np.isinf(view.depth_z_m[~view.valid]).all()
    assert np.isnan(view.normals()[~view.valid]).all()
    wide = replace(camera, lens=None, size_wh=(400, 300), cx=200.0, cy=150.0)
    pinhole = coffee.view(task="coco", camera=wide)
    for row, column in ((30, 45), (20, 60), (45, 30)):
        x, y = (column + 0.5 - 45) / 30, (row + 0.5 - 30) / 30
        out = np.tan(np.hypot(x, y)) / np.hypot(x, y) * 30
        at = int(150 + y * out), int(200 + x * out)
        near = pinhole.instance[at[0] - 1 : at[0] + 2, at[1] - 1 : at[1] + 2]
        assert view.instance[row, column] in near
    areas = [int((view.instance == r.id).sum()) for r in view.labelled]
    assert areas == [r.area_px for r in view.labelled]


def test_an_orbit_looks_at_its_centre(kitchen):
    cameras = legoworld.orbit(centre=(1, 2, 3), radius=2, n=4, elevation_deg=30, size_wh=SIZE)
    for n, camera in enumerate(cameras):
        np.testing.assert_allclose(camera.cam_from_world @ [1, 2, 3, 1], [0, 0, 2, 1], atol=1e-12)
        up = camera.cam_from_world[:3, :3] @ [0, 0, 1]
        assert up[0] == pytest.approx(0, abs=1e-12)
        assert up[1] == pytest.approx(-np.cos(np.pi / 6))
        assert camera.world_from_cam[2][3] == pytest.approx(3 + 2 * 0.5)
        assert np.linalg.det(camera.cam_from_world[:3, :3]) == pytest.approx(1)
        assert camera.name == f"orbit {n}"
    assert [v.camera.name for v in kitchen.views(cameras)] == [c.name for c in cameras]


def test_views_are_the_same_in_any_order_and_by_any_number_of_threads(kitchen):
    poses = [c.cam_from_world for c in legoworld.orbit(centre=(0, 0, 0), radius=4, n=7)]
    one = kitchen.views(cam_from_world=poses, size_wh=SIZE, fov_deg=60, task="coco", workers=1)
    many = kitchen.views(cam_from_world=poses, size_wh=SIZE, fov_deg=60, task="coco", workers=3)
    assert len(one) == 7
    drawn = [view.depth_z_m.tobytes() for view in one]
    assert [view.depth_z_m.tobytes() for view in many] == drawn
    assert [many[n].depth_z_m.tobytes() for n in (6, 0)] == [drawn[6], drawn[0]]
    stopped = iter(many)
    next(stopped)
    stopped.close()


def test_a_picture_that_is_kept_is_not_drawn_over(kitchen):
    """The kernel takes the memory of pictures that nobody holds again."""
    cameras = legoworld.orbit(centre=(0, 0, 0), radius=4, n=5, size_wh=SIZE)
    kept = [(view.depth_z_m, view.depth_z_m.copy()) for view in kitchen.views(cameras)]
    row = next(iter(kitchen.views(cameras))).depth_z_m[20]
    before = row.copy()
    for _ in kitchen.views(cameras):
        pass
    assert all((a == b).all() for a, b in kept)
    assert (row == before).all()


def test_a_file_is_a_scene_everywhere(scenes, cache, kitchen, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "folder"
    folder.mkdir()
    shutil.copyfile(scenes / "kitchen.blend", folder / "scene.blend")
    (folder / "labels.json").write_text('{"version": 1, "labels": []}')
    shutil.copyfile(scenes / "kitchen.blend", folder / "kitchen.blend")
    (folder / "frozen.json").write_text("not of the kitchen")
    lone = legoworld.open_scene(folder / "kitchen.blend", cache=cache)
    assert (
        lone.view(task="coco", size_wh=SIZE).predictions()
        == kitchen.view(task="coco", size_wh=SIZE).predictions()
    )
    with pytest.raises(legoworld.LegoWorldError, match=r"frozen\.json"):
        legoworld.open_scene(folder / "scene.blend", cache=cache)  # its folder, as strictly
    with pytest.raises(SceneMissingError, match=r"a file, and no \.blend"):
        legoworld.open_scene(folder / "labels.json")
    with pytest.raises(legoworld.LegoWorldError, match=r"no frozen\.json"):
        legoworld.open_scene(scenes / "kitchen.blend", cache=cache, require_frozen=True)
    file = str(scenes / "kitchen.blend")
    assert cli.run(["inspect", file, "--task", "coco", "--size", "64x48", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["instances"]
    assert {r["name"]: r["category_id"] for r in rows} == {"Near": 62, "Far": 72, "Rock": None}
    assert cli.run(["readout", file, "--task", "coco", "-o", "run"]) == 0
    (result,) = map(json.loads, Path("run/per_image.jsonl").read_text().splitlines())
    assert (result["file_name"], result["status"]) == ("kitchen", "ok")
    stored = json.loads(Path("run/predictions.json").read_text())
    assert sorted(stored, key=str) == sorted(kitchen.view(task="coco").predictions(), key=str)
    assert cli.run(["readout", file, "--task", "coco", "-o", "run"]) == 0  # resumed
    assert cli.run(["inspect", file, "--compare-sources"]) == 2


def test_a_glb_is_a_scene(scenes, kitchen):
    scene = legoworld.open_scene(scenes / "kitchen.glb")
    assert {"View 1", "View 4", "View 7"} <= set(scene.cameras)
    theirs = scene.view(task="coco", size_wh=SIZE, camera="View 0")  # glTF has no shift
    ours = kitchen.view(task="coco", size_wh=SIZE, camera="View 0")
    assert theirs.category_ids().tolist() == ours.category_ids().tolist() != []
    assert (theirs.masks() == ours.masks()).mean() > 0.99


def test_a_scene_without_a_camera_is_seen_from_poses(scenes, cache):
    scene = legoworld.open_scene(scenes / "nobody.blend", cache=cache)
    assert scene.cameras == {}
    cameras = legoworld.orbit(centre=(0, 0, 0), radius=4, n=2, elevation_deg=60)
    assert [len(view.labelled) for view in scene.views(cameras, task="coco")] == [2, 2]
    for ask in (scene.view, lambda: scene.views(cam_from_world=np.eye(4))):
        with pytest.raises(NoCameraError):
            ask()
    with legoworld.Reader(task="coco", workers=1, cache=cache) as reader:
        (reading,) = reader.read([scenes / "nobody.blend"])
    assert reading.status == "invalid"


def test_views_as_coco_are_opened_by_pycocotools(kitchen, coffee, tmp_path, capsys):
    views = kitchen.views(["View 7", "View 2"], size_wh=SIZE, task="coco-masks")
    document = legoworld.export(views, tmp_path / "out")
    opened = COCO(str(tmp_path / "out" / "annotations.json"))
    assert [i["file_name"] for i in opened.dataset["images"]] == ["View 7.png", "View 2.png"]
    for image_id, view in enumerate(views, start=1):
        annotations = opened.loadAnns(opened.getAnnIds(imgIds=[image_id]))
        assert [a["category_id"] for a in annotations] == view.category_ids().tolist()
        assert [a["bbox"] for a in annotations] == view.boxes_xywh_px().tolist()
        for annotation, mask in zip(annotations, view.masks(), strict=True):
            assert (opened.annToMask(annotation).astype(bool) == mask).all()
            assert annotation["area"] == mask.sum()
    assert len(document.annotations) == len(opened.dataset["annotations"])
    with pytest.raises(UsageError, match="already exists"):
        legoworld.export(views, tmp_path / "out")
    with pytest.raises(UsageError, match="categories of one task"):
        legoworld.export(coffee.views(["Camera"]), tmp_path / "other")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "views need cameras, or poses"),
        ({"cameras": ["Camera"], "cam_from_world": np.eye(4)}, "and not both"),
        ({"cam_from_world": np.eye(4), "world_from_cam": np.eye(4)}, "one direction"),
        ({"K": np.eye(3)}, "one direction"),
        ({"cam_from_world": np.eye(3)}, r"shape \(3, 3\)"),
        ({"cam_from_world": np.diag([1, 1, 2, 1.0])}, "no pose"),
        ({"cam_from_world": np.diag([1, 1, -1, 1.0])}, "no pose"),
        ({"cam_from_world": np.eye(4) * np.nan}, "NaN"),
        ({"cam_from_world": "poses"}, "shape"),
        ({"cam_from_world": np.eye(4), "K": np.eye(4)}, "argument K"),
        ({"cam_from_world": np.eye(4), "K": [[9, 1, 9], [0, 9, 9], [0, 0, 1]]}, "without skew"),
        ({"cam_from_world": np.eye(4), "K": [[-9, 0, 9], [0, 9, 9], [0, 0, 1]]}, "focal length"),
        ({"cam_from_world": np.eye(4), "K": np.eye(3), "fov_deg": 50}, "intrinsics are given once"),
        ({"cam_from_world": np.eye(4), "fov_deg": 180}, "fov_deg"),
        ({"cam_from_world": np.eye(4), "clip": (2, 1)}, "clip"),
        ({"cameras": [7]}, "no camera"),
        ({"cameras": ["Nobody"]}, "no camera 'Nobody'"),
        ({"cameras": "no such file"}, "holds no cameras"),
        ({"cameras": ["Camera"], "size_wh": 640}, "size_wh"),
        ({"cameras": ["Camera"], "workers": 0}, "workers"),
    ],
)
def test_odd_cameras_are_errors_of_ours(coffee, given, words):
    with pytest.raises(legoworld.LegoWorldError, match=words):
        coffee.views(**given)
