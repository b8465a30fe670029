"""COLMAP calibrations: cameras.{txt,bin} and images.{txt,bin}.

The formats are those of COLMAP's documentation, "Output Format"; points3D is not read.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

from legoworld.errors import LegoWorldError, cause

#: Model number of cameras.bin -> name and number of parameters (COLMAP, sensor/models.h).
BINARY_MODELS: Final = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
}
#: Words of a photo's line before its name: ID QW QX QY QZ TX TY TZ CAMERA_ID.
_WORDS_BEFORE_NAME: Final = 9
#: Bytes of one point of images.bin: x and y as doubles, the 3D point's id.
_POINT_BYTES: Final = 24
#: A photo's name, its camera's id, its pose as it is written.
_Photo = tuple[str, int, tuple[float, ...]]

K = TypeVar("K")
V = TypeVar("V")


class CalibrationError(LegoWorldError):
    """A COLMAP calibration cannot be read."""

    code = "calibration"


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera. params: in COLMAP's order for the model, in pixels from the top left corner."""

    model: str
    size_wh: tuple[int, int]
    params: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """A folder's cameras by id, the camera id of each photo by name, and the files read.

    poses: of each photo by name, cam_from_world as QW QX QY QZ TX TY TZ.
    """

    cameras: dict[int, Camera]
    camera_ids: dict[str, int]
    poses: dict[str, tuple[float, ...]]
    files: tuple[Path, ...]


def calibration_files(folder: Path) -> tuple[Path, ...]:
    """The calibration files of a folder: cameras, then photos if present.

    Empty without a cameras file. A pair of binary files takes precedence over text, as in COLMAP.
    """
    binary = folder / "cameras.bin", folder / "images.bin"
    if all(path.is_file() for path in binary):
        return binary
    text = folder / "cameras.txt", folder / "images.txt"
    return tuple(path for path in text if path.is_file()) if text[0].is_file() else ()


def read_calibration(folder: Path) -> Calibration:
    """The cameras and photos of a folder; CalibrationError when a file cannot be parsed."""
    files = calibration_files(folder)
    if not files:
        raise CalibrationError(
            f"{folder.parent.name}/{folder.name} contains no calibration",
            found="no cameras.txt",
            expected="COLMAP's cameras.txt and images.txt, or cameras.bin and images.bin",
        )
    binary = files[0].suffix == ".bin"
    of_cameras = _binary_cameras if binary else _text_cameras
    of_images = _binary_images if binary else _text_images
    cameras = _unique(of_cameras(files[0]), "camera", files[0])
    photos = list(of_images(files[1])) if len(files) > 1 else []
    listed = ((name, own) for name, own, _ in photos)
    camera_ids = _unique(listed, "photo", files[1]) if len(files) > 1 else {}
    poses = {name: pose for name, _, pose in reversed(photos)}
    poses = {name: poses[name] for name in camera_ids}
    return Calibration(cameras=cameras, camera_ids=camera_ids, poses=poses, files=files)


def _unique(entries: Iterator[tuple[K, V]], what: str, path: Path) -> dict[K, V]:
    """The entries by key; repeated entries must be equal."""
    by_key: dict[K, V] = {}
    for key, value in entries:
        if by_key.setdefault(key, value) != value:
            raise CalibrationError(
                f"{path.name} has two entries for {what} {key}",
                found=f"{by_key[key]} and {value}",
                expected="one",
            )
    return by_key


def _text_cameras(path: Path) -> Iterator[tuple[int, Camera]]:
    """Lines CAMERA_ID MODEL WIDTH HEIGHT PARAMS..."""
    for line in _lines(path):
        words = line.split()
        try:
            size_wh = int(words[2]), int(words[3])
            params = tuple(float(x) for x in words[4:])
            camera_id, model = int(words[0]), words[1]
        except (IndexError, ValueError) as error:
            raise _unreadable(path, line, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS") from error
        yield camera_id, _check_camera(Camera(model=model, size_wh=size_wh, params=params), path)


def _text_images(path: Path) -> Iterator[_Photo]:
    """Each photo's name, camera id and pose.

    A photo has a line ID QW QX QY QZ TX TY TZ CAMERA_ID NAME and a line of points (X Y ID)...,
    which may be blank. Editors and scripts drop or double blank lines, so a photo's line is
    recognised by its content instead of its position. Any other line is an error, as are two
    consecutive lines of points, one of which must have been a photo's.
    """
    points_may_follow = False
    for line in _lines(path):
        words = line.split(None, _WORDS_BEFORE_NAME)
        if _is_photo(words):
            pose = tuple(map(float, words[1:8]))
            yield words[_WORDS_BEFORE_NAME], int(words[_WORDS_BEFORE_NAME - 1]), pose
            points_may_follow = True
        elif points_may_follow and _are_points(words):
            points_may_follow = False
        else:
            raise _unreadable(path, line, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")


def _is_photo(words: list[str]) -> bool:
    """Whether the words are a photo's line; the last is the whole name, which may have spaces."""
    if len(words) <= _WORDS_BEFORE_NAME or not _is_integer(words[0]) or not _is_integer(words[8]):
        return False
    return all(map(_is_number, words[1:8])) and not _are_points(words)


def _are_points(words: list[str]) -> bool:
    """Whether the words are triples of numbers; the last may hold any number of words."""
    rest = words[-1].split()
    if (len(words) - 1 + len(rest)) % 3:
        return False
    return all(map(_is_number, words[:-1])) and all(map(_is_number, rest))


def _lines(path: Path) -> Iterator[str]:
    """The stripped lines of a text file that are neither blank nor comments."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise _unreadable_file(path, error, "a UTF-8 text file") from error
    # Python has turned \r\n into \n; splitlines would also cut names at rarer separators.
    stripped = (line.strip() for line in text.split("\n"))
    return (line for line in stripped if line and not line.startswith("#"))


def _binary_cameras(path: Path) -> Iterator[tuple[int, Camera]]:
    """Count (uint64), then id, model (int32), width, height (uint64) and doubles for each."""
    take = _reader(path)
    for _ in range(*take("<Q")):
        camera_id, model_id, width, height = take("<iiQQ")
        if model_id not in BINARY_MODELS:
            raise CalibrationError(
                f"{path.name} has a camera of an unknown model",
                found=f"model {model_id}",
                expected=", ".join(name for name, _ in BINARY_MODELS.values()),
            )
        model, count = BINARY_MODELS[model_id]
        camera = Camera(model=model, size_wh=(width, height), params=take(f"<{count}d"))
        yield camera_id, _check_camera(camera, path)


def _binary_images(path: Path) -> Iterator[_Photo]:
    """Count (uint64), then id, pose (7 doubles), camera id, a name that ends in 0, and points."""
    take = _reader(path)
    for _ in range(*take("<Q")):
        _, *pose, camera_id = take("<I7dI")
        name = bytearray()
        while (letter := take("<c")[0]) != b"\0":
            name += letter
        (points,) = take("<Q")
        take(f"<{points * _POINT_BYTES}x")
        try:
            yield name.decode("utf-8"), camera_id, tuple(pose)
        except UnicodeDecodeError as error:
            raise CalibrationError(
                f"{path.name} has a name that cannot be read", found=str(error), expected="UTF-8"
            ) from error


def _reader(path: Path) -> Callable[[str], tuple[Any, ...]]:
    """A function that reads the next values of a binary file by a struct format."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise _unreadable_file(path, error, "COLMAP's binary file") from error
    place = 0

    def take(layout: str) -> tuple[Any, ...]:
        nonlocal place
        try:
            values = struct.unpack_from(layout, data, place)
        except (struct.error, OverflowError, MemoryError) as error:
            raise CalibrationError(
                f"{path.name} is truncated or not a COLMAP file",
                found=f"{len(data)} bytes",
                expected="the number of entries that it declares",
            ) from error
        place += struct.calcsize(layout)
        return values

    return take


def _check_camera(camera: Camera, path: Path) -> Camera:
    if min(camera.size_wh) < 1 or not all(map(math.isfinite, camera.params)):
        raise CalibrationError(
            f"{path.name} has a camera that cannot be used",
            found=f"{camera.model}, {camera.size_wh[0]}x{camera.size_wh[1]}, {camera.params}",
            expected="a size of at least 1x1 and finite parameters",
        )
    return camera


def _unreadable_file(
    path: Path, error: OSError | UnicodeDecodeError, expected: str
) -> CalibrationError:
    return CalibrationError(
        f"{path.parent.name}/{path.name} cannot be read", found=cause(error), expected=expected
    )


def _unreadable(path: Path, line: str, expected: str) -> CalibrationError:
    return CalibrationError(
        f"{path.name} has a line that cannot be read", found=line[:100], expected=expected
    )


def _is_integer(word: str) -> bool:
    return word.isascii() and word.removeprefix("-").isdigit()


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False
