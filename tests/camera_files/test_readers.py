"""Camera files: every convention against vectors computed by hand."""

from __future__ import annotations

import json
import math
import struct
import sys

import numpy as np
import pytest

from legoworld.camera_files.read import read_camera_file
from legoworld.tracks.colmap import CalibrationError
from legoworld.visibility.lens import undistort

S = math.sqrt(0.5)


def pixel(camera, point):
    """Where a camera shows a world point: u, v of its pinhole."""
    x, y, z, _ = camera.cam_from_world @ [*point, 1.0]
    return camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy


def colmap(folder, camera="1 PINHOLE 640 480 500 510 320.5 240.25", pose="1 0 0 0 0 0 0"):
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_text(f"# a comment\n{camera}\n")
    (folder / "images.txt").write_text(f"7 {pose} 1 photos/a b.jpg\n1.0 2.0 -1\n")
    return folder


def test_a_colmap_camera_at_the_origin_looks_along_z(tmp_path):
    (camera,) = read_camera_file(colmap(tmp_path))
    assert (camera.name, camera.size_wh, camera.lens) == ("photos/a b.jpg", (640, 480), None)
    assert pixel(camera, (0, 0, 2)) == (320.5, 240.25)
    assert pixel(camera, (1, 1, 2)) == pytest.approx((570.5, 495.25))  # x right, y down
    assert camera.K.tolist() == [[500, 0, 320.5], [0, 510, 240.25], [0, 0, 1]]


def test_a_colmap_pose_is_camera_from_world(tmp_path):
    """Turned by 90 degrees about y, so that the camera looks along -x; then 3 backwards."""
    (camera,) = read_camera_file(colmap(tmp_path, pose=f"{2 * S} 0 {2 * S} 0 0 0 3"))
    world_from_cam = np.array(camera.world_from_cam)
    np.testing.assert_allclose(world_from_cam[:, 2], [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(world_from_cam[:, 3], [3, 0, 0], atol=1e-15)
    assert pixel(camera, (0, 0, 0)) == pytest.approx((320.5, 240.25))
    assert pixel(camera, (0, 0, 1)) == pytest.approx((320.5 + 500 / 3, 240.25))


@pytest.mark.parametrize(
    ("camera", "fisheye", "coefficients"),
    [
        ("SIMPLE_RADIAL 64 48 50 32 24 .1", False, (0.1, 0, 0, 0, 0, 0, 0, 0)),
        ("RADIAL 64 48 50 32 24 .1 .02", False, (0.1, 0.02, 0, 0, 0, 0, 0, 0)),
        ("OPENCV 64 48 50 51 32 24 .1 .02 .003 .004", False,
         (0.1, 0.02, 0.003, 0.004, 0, 0, 0, 0)),
        ("SIMPLE_RADIAL_FISHEYE 64 48 50 32 24 .1", True, (0.1, 0, 0, 0, 0, 0, 0, 0)),
        ("RADIAL_FISHEYE 64 48 50 32 24 .1 .02", True, (0.1, 0.02, 0, 0, 0, 0, 0, 0)),
        ("OPENCV_FISHEYE 64 48 50 51 32 24 .1 .02 .03 .04", True,
         (0.1, 0.02, 0, 0, 0.03, 0.04, 0, 0)),
        ("THIN_PRISM_FISHEYE 64 48 50 51 32 24 .1 .02 .003 .004 .05 .06 .007 .008", True,
         (0.1, 0.02, 0.003, 0.004, 0.05, 0.06, 0.007, 0.008)),
    ],
)  # fmt: skip
def test_colmap_models_against_pycolmap(tmp_path, camera, fisheye, coefficients):
    (read,) = read_camera_file(colmap(tmp_path, camera=f"1 {camera}"))
    assert read.lens.fisheye == fisheye
    assert read.lens.coefficients == coefficients
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    model, width, height, *params = camera.split()
    theirs = pycolmap.Camera(
        model=model, width=int(width), height=int(height), params=list(map(float, params))
    )
    pixels = np.random.default_rng(0).uniform((10, 10), (54, 38), (50, 2))
    ours = undistort(read.lens, (read.fx, read.fy), (read.cx, read.cy), pixels).xy_px
    rays = theirs.cam_from_img(pixels)
    np.testing.assert_allclose((ours - [read.cx, read.cy]) / [read.fx, read.fy], rays, atol=1e-6)


def test_eth3d_s_two_calibrations_of_courtyard_agree(tmp_path):
    """Camera 0 of dslr_calibration_jpg, and the size and centre of its undistorted picture."""
    lens = ".21047 .21102 -5.36231e-06 .00051541 -.158023 .406856 -8.46499e-05 .000861313"
    numbers = f"6048 4032 3411.42 3410.02 3041.29 2014.07 {lens}"
    (read,) = read_camera_file(colmap(tmp_path, camera=f"1 THIN_PRISM_FISHEYE {numbers}"))
    corners = np.array([(x, y) for y in (0.0, 4032.0) for x in (0.0, 6048.0)])
    ours = undistort(read.lens, (read.fx, read.fy), (read.cx, read.cy), corners).xy_px
    theirs = [(x, y) for y in (0, 4129) for x in (0, 6198)]
    shifted = ours - (read.cx, read.cy) + (3116.72, 2062.52)
    np.testing.assert_allclose(shifted, theirs, atol=5)  # their edges are cut to what is seen
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    params = [*map(float, numbers.split()[2:])]
    camera = pycolmap.Camera(model="THIN_PRISM_FISHEYE", width=6048, height=4032, params=params)
    pixels = np.random.default_rng(0).uniform((0, 0), (6048, 4032), (200, 2))
    found = undistort(read.lens, (read.fx, read.fy), (read.cx, read.cy), pixels).xy_px
    rays = (found - (read.cx, read.cy)) / (read.fx, read.fy)
    np.testing.assert_allclose(rays, camera.cam_from_img(pixels), atol=1e-8)


def test_colmap_in_binary_says_the_same(tmp_path):
    text = colmap(tmp_path / "text", pose="0.5 0.5 -0.5 0.5 1 2 3")
    folder = tmp_path / "binary"
    folder.mkdir()
    (folder / "cameras.bin").write_bytes(
        struct.pack("<QiiQQ4d", 1, 1, 1, 640, 480, 500, 510, 320.5, 240.25)
    )
    photo = struct.pack("<QI7dI", 1, 7, 0.5, 0.5, -0.5, 0.5, 1, 2, 3, 1)
    (folder / "images.bin").write_bytes(photo + b"photos/a b.jpg\0" + struct.pack("<Q", 0))
    assert read_camera_file(folder) == read_camera_file(text)


def transforms(folder, **changes):
    frame = {
        "file_path": "images/0.png",
        # Blender's camera 4 above the origin, looking down, its up along +y.
        "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]],
    }
    file = {"w": 640, "h": 480, "fl_x": 500, "cx": 300, "frames": [frame]}
    path = folder / "transforms.json"
    path.write_text(json.dumps({k: v for k, v in {**file, **changes}.items() if v is not None}))
    return path


def test_nerfstudio_poses_have_opengl_axes(tmp_path):
    (camera,) = read_camera_file(transforms(tmp_path))
    assert pixel(camera, (0, 0, 0)) == (300, 240)  # cy: the middle; fl_y: fl_x
    u, v = pixel(camera, (1, 1, 0))
    assert (u, v) == (300 + 500 / 4, 240 - 500 / 4)  # y of the world is up in the picture
    assert read_camera_file(tmp_path) == [camera]


def test_nerf_synthetic_has_an_angle_alone(tmp_path):
    angle = 2 * math.atan(0.5)
    (camera,) = read_camera_file(transforms(tmp_path, fl_x=None, cx=None, camera_angle_x=angle))
    assert (camera.fx, camera.cx) == (pytest.approx(640), 320)


def test_nerfstudio_frames_speak_for_themselves(tmp_path):
    frame = {
        "file_path": "b.png", "transform_matrix": np.eye(4).tolist(), "fl_x": 7, "fl_y": 8,
        "w": 20, "h": 10, "k1": 0.1,
    }  # fmt: skip
    (camera,) = read_camera_file(
        transforms(tmp_path, camera_model="OPENCV_FISHEYE", k4=0.2, frames=[frame])
    )
    assert (camera.fx, camera.fy, camera.size_wh) == (7, 8, (20, 10))
    assert camera.lens.fisheye
    assert camera.lens.coefficients == (0.1, 0, 0, 0, 0, 0.2, 0, 0)


def test_bop_is_in_millimetres_and_has_its_first_pixel_at_zero(tmp_path):
    folder = tmp_path / "train_pbr" / "000000"
    folder.mkdir(parents=True)
    (tmp_path / "camera.json").write_text('{"width": 640, "height": 480, "depth_scale": 1.0}')
    view = {
        "cam_K": [600, 0, 319.5, 0, 600, 239.5, 0, 0, 1],  # BlenderProc's without shift
        "cam_R_w2c": [1, 0, 0, 0, -1, 0, 0, 0, -1],
        "cam_t_w2c": [0, 0, 2000],
    }
    (folder / "scene_camera.json").write_text(json.dumps({"1": view, "0": view}))
    first, second = read_camera_file(folder)
    assert (first.name, second.name, first.size_wh) == ("000000", "000001", (640, 480))
    assert pixel(first, (0, 0, 0)) == (320, 240)  # the middle of the picture
    assert pixel(first, (0, 1, 0)) == (320, 240 - 300)
    assert np.array(first.world_from_cam)[:, 3].tolist() == [0, 0, 2]


def hdf5(folder, name="0.hdf5", colors=(48, 64, 3), **changes):
    """As BlenderProc's write_hdf5 leaves a frame of a pipeline with a CameraStateWriter."""
    h5py = pytest.importorskip("h5py")
    pose = {
        # Blender's camera 4 above the origin, looking down, its up along +y.
        "cam2world_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]],
        "cam_K": [[50, 0, 31.5], [0, 50, 23.5], [0, 0, 1]],
    }
    pose = {key: value for key, value in {**pose, **changes}.items() if value is not None}
    with h5py.File(folder / name, "w") as file:
        file["campose"] = np.bytes_(json.dumps([pose]))
        if colors:
            file.create_dataset("colors", data=np.zeros(colors, np.uint8), compression="gzip")
    return folder / name


def test_blenderproc_s_hdf5_has_blender_s_axes_and_its_first_pixel_at_zero(tmp_path):
    (camera,) = read_camera_file(hdf5(tmp_path))
    assert (camera.name, camera.size_wh) == ("0", (64, 48))
    assert pixel(camera, (0, 0, 0)) == (32, 24)  # the middle of the picture
    assert pixel(camera, (1, 1, 0)) == (32 + 12.5, 24 - 12.5)  # y of the world is up
    for name in ("10.hdf5", "2.hdf5"):
        hdf5(tmp_path, name)
    assert [one.name for one in read_camera_file(tmp_path)] == ["0", "2", "10"]


def test_without_h5py_one_sentence_says_how_to_get_it(tmp_path, monkeypatch):
    (tmp_path / "0.hdf5").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(CalibrationError, match=r"0.hdf5 needs h5py.*pip install"):
        read_camera_file(tmp_path)


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda d: hdf5(d, colors=None), "which would tell the size"),
        (lambda d: hdf5(d, cam_K=None), "cam_K"),
        (lambda d: hdf5(d, cam2world_matrix=[[1.0]]), "1 rows"),
        (lambda d: hdf5(d).write_bytes(b"no") and d, "0.hdf5 has no camera"),
        (lambda d: d / "none", "no such file"),
        (lambda d: colmap(d, camera="1 FOV 64 48 50 50 32 24 .1"), "model that is not read"),
        (lambda d: colmap(d, pose="0 0 0 0 0 0 0"), "no rotation"),
        (lambda d: (colmap(d) / "images.txt").unlink() or d, "no photo with a pose"),
        (lambda d: transforms(d, w=None), "no w and h"),
        (lambda d: transforms(d, fl_x=None), "no focal length"),
        (lambda d: transforms(d, camera_model="EQUIRECTANGULAR"), "camera_model"),
        (lambda d: transforms(d, frames=[{}]), "cannot be read"),
        (lambda d: (d / "scene_camera.json").write_text("{}") and d, "picture size"),
    ],
)  # fmt: skip
def test_what_is_no_camera_file(tmp_path, write, words):
    with pytest.raises(CalibrationError, match=words):
        read_camera_file(write(tmp_path))
