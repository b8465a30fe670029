"""ETH3D on disk: where a photo's raw depth and calibration lie, and what the calibration says."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.evaluation.depth.cameras import Camera
from legoworld.evaluation.depth.errors import DepthTruthError

_FILE_NAME: Final = re.compile(r"(?P<scene>[^/]+)/images/dslr_images/(?P<name>[^/]+)")
#: The dataset's own tree, then Marigold's (depth beside rgb); {scene} and {name} are filled in.
_DEPTH: Final = (
    "{scene}/ground_truth_depth/dslr_images/{name}",
    "depth/{scene}_dslr_depth/{scene}/ground_truth_depth/dslr_images/{name}",
)
_CALIBRATION: Final = (
    "{scene}/dslr_calibration_jpg",
    "rgb/{scene}/dslr_calibration_jpg",
    "depth/{scene}_dslr_depth/{scene}/dslr_calibration_jpg",
)


@dataclass(frozen=True, kw_only=True)
class Eth3dFiles:
    """One photo's files. calibration: the folder of cameras.txt, None where there is none."""

    scene: str
    name: str
    depth: Path
    calibration: Path | None


def scene_of(file_name: str) -> str | None:
    """The ETH3D scene a photo is of; None when the name is not `<scene>/images/dslr_images/X`."""
    match = _FILE_NAME.fullmatch(file_name)
    return match["scene"] if match else None


def find_files(truth: Path, file_name: str) -> Eth3dFiles | None:
    """A photo's files below the truth folder, in either tree; None without a depth file."""
    match = _FILE_NAME.fullmatch(file_name)
    if match is None:
        return None
    parts = match.groupdict()
    depths = [truth / pattern.format(**parts) for pattern in _DEPTH]
    depth = next((path for path in depths if path.is_file()), None)
    if depth is None:
        return None
    folders = [truth / pattern.format(**parts) for pattern in _CALIBRATION]
    calibration = next((f for f in folders if (f / "cameras.txt").is_file()), None)
    return Eth3dFiles(**parts, depth=depth, calibration=calibration)


def photo_camera(calibration: Path, name: str) -> Camera:
    """The camera of a photo, by images.txt and cameras.txt. DepthTruthError when unclear."""
    cameras = read_cameras(calibration / "cameras.txt")
    images = calibration / "images.txt"
    if not images.is_file() and len(cameras) == 1:
        return next(iter(cameras.values()))
    camera_ids = read_image_cameras(images) if images.is_file() else {}
    camera_id = camera_ids.get(f"dslr_images/{name}", camera_ids.get(name))
    if camera_id not in cameras:
        raise DepthTruthError(
            f"the calibration does not say which camera took {name}",
            found=f"{len(camera_ids)} photos in images.txt, {len(cameras)} in cameras.txt",
            expected=f"dslr_images/{name} in images.txt and its camera in cameras.txt",
        )
    return cameras[camera_id]


def read_cameras(path: Path) -> dict[int, Camera]:
    """cameras.txt: ID MODEL WIDTH HEIGHT PARAMS... by id. DepthTruthError for another line."""
    cameras: dict[int, Camera] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            camera = Camera(
                model=words[1],
                size_wh=(int(words[2]), int(words[3])),
                params=tuple(float(x) for x in words[4:]),
            )
            cameras[int(words[0])] = camera
        except (IndexError, ValueError) as error:
            raise DepthTruthError(
                "cameras.txt has a line that cannot be read",
                found=line[:100],
                expected="ID MODEL WIDTH HEIGHT PARAMS",
            ) from error
        if min(camera.size_wh) < 1:
            raise DepthTruthError("cameras.txt has a camera without a size", found=line[:100])
    return cameras


def read_image_cameras(path: Path) -> dict[str, int]:
    """images.txt: the camera id of every photo, by name.

    A photo has two lines, ID QW QX QY QZ TX TY TZ CAMERA_ID NAME and its points (X Y ID)..., and
    the second may be blank or lost with the blank lines. So a photo's line is told by its words:
    at least ten, the tenth no number.
    """
    camera_ids: dict[str, int] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        words = line.split()
        if len(words) < 10 or words[0].startswith("#") or _is_number(words[9]):
            continue
        camera_ids[" ".join(words[9:])] = int(words[8])
    return camera_ids


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
