"""COLMAP's files, text whatever happened to blank lines and binary, held to pycolmap."""

from __future__ import annotations

import itertools
import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from legoworld.tracks.colmap import (
    BINARY_MODELS,
    CalibrationError,
    Camera,
    calibration_files,
    read_calibration,
)

CAMERAS = "# Camera list\n0 PINHOLE 10 20 1 2 3 4\n1 THIN_PRISM_FISHEYE 30 20" + " 1" * 12 + "\n"
POSE = "0.1 -0.2 3e-1 0.4 1 2 3"
POINTS = "10.5 20.5 -1 30 40 7 1 2 3 4 5 6"
#: A line of points whose first ten words look like a photo's but for the name.
LIKE_A_PHOTO = "1 2 3 4 5 6 7 8 1 10 11 12 13 14 15"


def calibration(folder: Path, images: str, cameras: str = CAMERAS) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_bytes(cameras.encode())
    (folder / "images.txt").write_bytes(images.encode())
    return folder


def photo_ids(folder: Path, images: str) -> dict[str, int]:
    return read_calibration(calibration(folder, images)).camera_ids


def test_blank_lost_doubled_and_full_lines_of_points(tmp_path: Path) -> None:
    expected = {"dslr_images/A.JPG": 0, "dslr_images/with space.JPG": 1, "0042": 0, "C": 1}
    heads = [f"{i} {POSE} {camera} {name}" for i, (name, camera) in enumerate(expected.items())]
    comments = "# Image list\n#   POINTS2D[] as (X, Y, ID)\n"
    for gaps in itertools.product(["", "\n\n", LIKE_A_PHOTO + "\n"], repeat=4):
        text = "".join(f"{head}\n{gap}" for head, gap in zip(heads, gaps, strict=True))
        assert photo_ids(tmp_path, comments + text) == expected
        assert photo_ids(tmp_path, "\ufeff" + text.replace("\n", "\r\n")) == expected
        assert photo_ids(tmp_path, text.replace("\n", "  \n").rstrip()) == expected


names = st.text("abcXYZ012_-./ é#", min_size=1, max_size=12).map(str.strip).filter(bool)
numbers = st.floats(-1e6, 1e6).map(repr) | st.integers(-9, 9).map(str)
point = st.tuples(numbers, numbers, st.integers(-1, 9).map(str)).map(" ".join)


def is_like_points(name: str) -> bool:
    """Whether a name could be the end of a line of points: numbers only, as many as fill threes."""
    try:
        return (len([float(word) for word in name.split()]) + 9) % 3 == 0
    except ValueError:
        return False


@settings(max_examples=80)
@given(
    photos=st.dictionaries(names, st.integers(0, 1), min_size=1, max_size=5),
    points=st.lists(st.lists(point, max_size=5).map(" ".join), min_size=5, max_size=5),
    noise=st.lists(st.sampled_from(["", "\n", "# 1 2 3\n", " \t\n\n"]), min_size=10, max_size=10),
)
def test_any_photos_whatever_was_done_to_blank_lines(
    tmp_path_factory: pytest.TempPathFactory,
    photos: dict[str, int],
    points: list[str],
    noise: list[str],
) -> None:
    photos = {name: camera for name, camera in photos.items() if not is_like_points(name)}
    text = ""
    for i, (name, camera) in enumerate(photos.items()):
        text += f"{i} {POSE} {camera} {name}\n{noise[2 * i]}"
        text += f"{points[i]}\n{noise[2 * i + 1]}" if points[i] else noise[2 * i + 1]
    # A name keeps its spaces; a line is its words.
    assert photo_ids(tmp_path_factory.getbasetemp() / "colmap", text) == photos


@pytest.mark.parametrize(
    "images",
    [
        f"{POINTS}\n1 {POSE} 0 A.JPG\n",  # points of no photo
        f"1 {POSE} 0 A.JPG\n{POINTS}\n{POINTS}\n",  # a photo's line was lost
        f"1 {POSE} 0\n\n",  # no name
        f"1 {POSE.replace('2 3', 'nan 3')} 0 A.JPG\n",
        f"1 {POSE} x A.JPG\n",
        "1 2 A.JPG\n",
        f"1 {POSE} 0 A.JPG\n\n2 {POSE} 1 A.JPG\n",  # one photo of two cameras
    ],
)
def test_what_is_neither_a_photo_nor_its_points_is_refused(tmp_path: Path, images: str) -> None:
    with pytest.raises(CalibrationError, match=r"images\.txt"):
        photo_ids(tmp_path, images)


@pytest.mark.parametrize(
    "line",
    [
        "0 PINHOLE",
        "x PINHOLE 1 2 3",
        "0 PINHOLE 4 0 1 1 1 1",
        "0 PINHOLE 4 4 1 nan 1 1",
        "0 PINHOLE 4 4 1 1 1 inf",
        "0 PINHOLE 4 4 1 1 1 1\n0 PINHOLE 5 4 1 1 1 1",
    ],
)
def test_cameras_txt_with_a_mistake(tmp_path: Path, line: str) -> None:
    with pytest.raises(CalibrationError, match=r"cameras\.txt"):
        read_calibration(calibration(tmp_path, "", line + "\n"))


def test_a_line_that_cannot_be_read_is_shown_to_its_hundredth_letter(tmp_path: Path) -> None:
    line = f"0 PINHOLE {'x' * 200}"
    shown = f"cameras.txt has a line that cannot be read; found: {line[:100]}; expected: CAMERA_ID"
    with pytest.raises(CalibrationError) as caught:
        read_calibration(calibration(tmp_path, "", line + "\n"))
    assert str(caught.value).startswith(shown)


def test_text_that_is_none(tmp_path: Path) -> None:
    (calibration(tmp_path, "") / "images.txt").write_bytes(b"1 \xff\xfe\n")
    with pytest.raises(CalibrationError, match=r"images\.txt cannot be read"):
        read_calibration(tmp_path)
    with pytest.raises(CalibrationError, match="no calibration"):
        read_calibration(tmp_path / "nothing")


@pytest.fixture
def pycolmap() -> Any:
    return pytest.importorskip("pycolmap", reason="pycolmap is not installed")


def reconstruction(pycolmap: Any, names: list[str]) -> Any:
    """Two cameras, and a photo for each name; every second one has points."""
    made = pycolmap.Reconstruction()
    for camera_id, (model, n) in ((1, ("PINHOLE", 4)), (7, ("THIN_PRISM_FISHEYE", 12))):
        params = [100.5 + i / 7 for i in range(4)] + [i / 1e3 for i in range(n - 4)]
        made.add_camera_with_trivial_rig(
            pycolmap.Camera(
                model=model, width=64 + camera_id, height=48, params=params, camera_id=camera_id
            )
        )
    for i, name in enumerate(names, start=1):
        image = pycolmap.Image(name=name, camera_id=(1, 7)[i % 2], image_id=i)
        if i % 2:
            image.points2D = [pycolmap.Point2D([10.0, 20.0]), pycolmap.Point2D([3.5, 4.0])] * i
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(), [i, 2.5, 3])
        made.add_image_with_trivial_frame(image, pose)
    return made


NAMES = ["dslr_images/DSC_0001.JPG", "dslr_images/b.png", "0007", "c/d/e.JPG", "é.JPG"]


@pytest.mark.parametrize("kind", ["text", "binary"])
def test_files_that_pycolmap_writes(pycolmap: Any, tmp_path: Path, kind: str) -> None:
    made = reconstruction(pycolmap, NAMES)
    getattr(made, f"write_{kind}")(str(tmp_path))
    found = read_calibration(tmp_path)
    assert {path.suffix for path in found.files} == {".txt" if kind == "text" else ".bin"}
    assert found.camera_ids == {image.name: image.camera_id for image in made.images.values()}
    assert found.cameras == {
        camera_id: Camera(
            model=camera.model.name,
            size_wh=(camera.width, camera.height),
            params=tuple(camera.params),
        )
        for camera_id, camera in made.cameras.items()
    }


def test_text_as_eth3d_writes_it_is_what_pycolmap_reads(pycolmap: Any, tmp_path: Path) -> None:
    """Ids from 0, two-line comments, a blank line where a photo has no points."""
    images = f"# a\n# b\n0 {POSE} 0 dslr_images/A.JPG\n\n1 {POSE} 1 dslr_images/B.JPG\n{POINTS}\n"
    calibration(tmp_path, images)
    (tmp_path / "points3D.txt").write_text("")
    theirs = pycolmap.Reconstruction()
    theirs.read_text(str(tmp_path))
    ours = read_calibration(tmp_path)
    assert ours.camera_ids == {image.name: image.camera_id for image in theirs.images.values()}
    for camera_id, camera in theirs.cameras.items():
        assert ours.cameras[camera_id].size_wh == (camera.width, camera.height)
        assert ours.cameras[camera_id].params == tuple(camera.params)


def test_the_models_of_binary_files_are_pycolmap_s(pycolmap: Any) -> None:
    theirs = pycolmap.CameraModelId.__members__
    for number, (name, count) in BINARY_MODELS.items():
        assert int(theirs[name]) == number
        camera = pycolmap.Camera.create_from_model_id(1, theirs[name], 1.0, 10, 10)
        assert len(camera.params) == count


def test_binary_files_that_are_cut_or_lie(pycolmap: Any, tmp_path: Path) -> None:
    reconstruction(pycolmap, NAMES[:2]).write_binary(str(tmp_path))
    for name in ("cameras.bin", "images.bin"):
        whole = (tmp_path / name).read_bytes()
        for end in range(0, len(whole), 5):
            (tmp_path / name).write_bytes(whole[:end])
            with pytest.raises(CalibrationError, match=rf"{name} is truncated"):
                read_calibration(tmp_path)
        (tmp_path / name).write_bytes(struct.pack("<Q", 1 << 62) + whole[8:])
        with pytest.raises(CalibrationError, match=name):
            read_calibration(tmp_path)
        (tmp_path / name).write_bytes(whole)
    (tmp_path / "images.bin").unlink()
    assert calibration_files(tmp_path) == ()


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "cameras.txt", "images.txt"])
def test_a_file_that_the_system_refuses_is_named(tmp_path: Path, name: str) -> None:
    folder = calibration(tmp_path / "dslr_calibration", f"1 {POSE} 0 a\n")
    if name.endswith(".bin"):
        (folder / "cameras.bin").write_bytes(struct.pack("<Q", 0))
        (folder / "images.bin").write_bytes(struct.pack("<Q", 0))
    (folder / name).unlink()
    (folder / name).symlink_to("/proc/self/mem")  # reading its beginning is an I/O error
    with pytest.raises(CalibrationError) as caught:
        read_calibration(folder)
    kind = "COLMAP's binary file" if name.endswith(".bin") else "a UTF-8 text file"
    assert str(caught.value) == (
        f"dslr_calibration/{name} cannot be read; found: Input/output error; expected: {kind}"
    )


def test_models_and_their_parameters_are_colmaps() -> None:
    """colmap/sensor/models.h: model_id, model_name, num_params."""
    assert {number: f"{name} {count}" for number, (name, count) in BINARY_MODELS.items()} == {
        0: "SIMPLE_PINHOLE 3", 1: "PINHOLE 4", 2: "SIMPLE_RADIAL 4", 3: "RADIAL 5", 4: "OPENCV 8",
        5: "OPENCV_FISHEYE 8", 6: "FULL_OPENCV 12", 7: "FOV 5", 8: "SIMPLE_RADIAL_FISHEYE 4",
        9: "RADIAL_FISHEYE 5", 10: "THIN_PRISM_FISHEYE 12", 11: "RAD_TAN_THIN_PRISM_FISHEYE 16",
    }  # fmt: skip


def test_a_photo_without_a_name_is_no_photo(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError):
        photo_ids(tmp_path, f"1 {POSE} 0\n")


def test_cameras_without_photos_are_a_calibration(tmp_path: Path) -> None:
    (calibration(tmp_path, "") / "images.txt").unlink()
    found = read_calibration(tmp_path)
    assert set(found.cameras) == {0, 1}
    assert found.camera_ids == {}
    assert found.files == (tmp_path / "cameras.txt",)
    (tmp_path / "images.txt").write_text(f"1 {POSE} 0 A.JPG\n")
    (tmp_path / "images.bin").write_bytes(b"half of a pair")
    assert read_calibration(tmp_path).files == (tmp_path / "cameras.txt", tmp_path / "images.txt")
