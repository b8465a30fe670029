"""ETH3D on disk: a photo's raw depth, calibration and camera."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from legoworld.evaluation.depth.arrays import DepthTruthError
from legoworld.files import names_a_file
from legoworld.records.base import decode
from legoworld.records.track import ListedImage
from legoworld.shipped import catalog
from legoworld.tasks.shipped import ETH3D
from legoworld.tracks.colmap import Calibration, Camera, calibration_files

#: The folder of a scene's photos, below images/ and in images.txt.
PHOTOS: Final = "dslr_images"
_FILE_NAME: Final = re.compile(rf"(?P<scene>[^/]+)/images/{PHOTOS}/(?P<name>[^/]+)")
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
    """One photo's files. calibration: the folder of the cameras' file, None without one."""

    scene: str
    name: str
    depth: Path
    calibration: Path | None


def parse_scene_name(file_name: str) -> str | None:
    """The ETH3D scene of a photo; None if the name is not `<scene>/images/dslr_images/X`."""
    match = _FILE_NAME.fullmatch(file_name)
    return match["scene"] if match else None


@cache
def training_images() -> tuple[ListedImage, ...]:
    """ETH3D's 454 training images: id and file name, from the shipped list."""
    path = catalog.folder("datasets") / ETH3D.name / "images.json"
    return decode(tuple[ListedImage, ...], path.read_bytes())


def find_files(truth: Path, file_name: str) -> Eth3dFiles | None:
    """A photo's files below the ground-truth folder, in either tree; None without a depth file."""
    match = _FILE_NAME.fullmatch(file_name)
    if match is None:
        return None
    parts = match.groupdict()
    depths = [truth / pattern.format(**parts) for pattern in _DEPTH]
    depth = next((path for path in depths if names_a_file(path)), None)
    if depth is None:
        return None
    return Eth3dFiles(**parts, depth=depth, calibration=find_calibration(truth, parts["scene"]))


def find_calibration(truth: Path, scene: str) -> Path | None:
    """The folder of a scene's calibration below the ground-truth folder, in either tree."""
    folders = [truth / pattern.format(scene=scene) for pattern in _CALIBRATION]
    return next((folder for folder in folders if calibration_files(folder)), None)


def scenes_below(truth: Path) -> list[str]:
    """Sorted names of the scenes with a calibration below the ground-truth folder."""
    below = [path.parent.name for p in _CALIBRATION for path in truth.glob(p.format(scene="*"))]
    return sorted({scene for scene in below if find_calibration(truth, scene)})


def photo_camera(calibration: Calibration, name: str) -> Camera:
    """The camera that took a photo. DepthTruthError if the calibration does not list it."""
    cameras, camera_ids = calibration.cameras, calibration.camera_ids
    if len(calibration.files) == 1 and len(cameras) == 1:
        return next(iter(cameras.values()))
    camera_id = camera_ids.get(f"{PHOTOS}/{name}", camera_ids.get(name))
    if camera_id not in cameras:
        raise DepthTruthError(
            f"the calibration does not name the camera of {name}",
            found=f"{len(camera_ids)} photos in images.txt, {len(cameras)} in cameras.txt",
            expected=f"{PHOTOS}/{name} in images.txt and its camera in cameras.txt",
        )
    return cameras[camera_id]
