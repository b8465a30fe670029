"""A run of boxes in space as Omni3D's JSON, which `evaluate` takes as truth, or KITTI's files.

Everything is taken from the corners, so imported boxes are exported as a scene's are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.api.coco_export import vocabulary_of_run
from legoworld.errors import UsageError
from legoworld.evaluation.detection.payloads.boxes3d import BOXES3D
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.run import Run, RunUnusableError, read_predictions, read_run
from legoworld.files import readable_json, write_text
from legoworld.records.base import UnsetType, decode
from legoworld.records.folders.read_run import RUN
from legoworld.records.predictions import Prediction
from legoworld.records.run_file import RunFile
from legoworld.records.run_rows import RunImage
from legoworld.visibility.cuboids import box_of_corners, extent_px, lines_px

#: KITTI's `occluded` by the share that nothing hides: 0 from the first on, 1 from the second on.
KITTI_OCCLUSION: Final = (0.9, 0.5)
_UNKNOWN: Final = -1


@dataclass(frozen=True, kw_only=True)
class SpaceExport:
    """What was written. tilt_deg: the largest angle between a box's and the camera's vertical."""

    images: int
    annotations: int
    tilt_deg: float


@dataclass(frozen=True, kw_only=True)
class _Photo:
    image: RunImage
    size_wh: tuple[int, int]
    intrinsics: list[list[float]]
    predictions: list[Prediction]


def export_boxes3d(
    run_folder: Path, output: Path, *, form: str, track: Path | None, overwrite: bool
) -> SpaceExport:
    """Write a run of boxes in space. form: omni3d, one JSON; kitti, a folder.

    Raises UsageError for runs of other tasks and existing output, RunUnusableError for a run
    without cameras (an import); nothing is written then.
    """
    if output.exists() and not overwrite:
        raise UsageError(
            f"{output.name} already exists",
            expected="a new file or folder",
            next_step="choose another -o, or pass --overwrite",
        )
    run = read_run(run_folder)
    if detection_protocol(run.task).payload is not BOXES3D:
        raise UsageError(
            f"a run of {run.task} has no boxes in space",
            expected="a run of boxes in space",
            next_step="pass --format coco",
        )
    vocabulary = vocabulary_of_run(run, track)
    names = {c.id: c.name for c in vocabulary.categories}
    photos = list(_photos(run))
    if form == "omni3d":
        write_text(output, readable_json(_omni3d(run, photos, names)))
    else:
        for photo in photos:
            stem = PurePosixPath(photo.image.file_name).with_suffix(".txt")
            for folder, text in (("label_2", _labels(photo, names)), ("calib", _calib(photo))):
                path = output / folder / stem
                path.parent.mkdir(parents=True, exist_ok=True)
                write_text(path, text)
    boxes = [_axes(p) for photo in photos for p in photo.predictions]
    tilt = max((math.degrees(math.acos(min(abs(float(a[1, 1])), 1.0))) for a in boxes), default=0.0)
    return SpaceExport(images=len(photos), annotations=len(boxes), tilt_deg=tilt)


def _photos(run: Run) -> Iterator[_Photo]:
    """The images that were read, each with its camera and boxes."""
    sources = decode(RunFile, (run.folder / RUN).read_bytes()).scenes
    by_image: dict[int, list[Prediction]] = {}
    for batch in read_predictions(run, Prediction):
        for prediction in batch:
            by_image.setdefault(prediction.image_id, []).append(prediction)
    for image in run.images:
        if image.status != "ok":
            continue
        source = sources.get(str(image.image_id))
        camera = source.projection if source else None
        if not camera or camera.orthographic or image.size_wh is None:
            raise RunUnusableError(
                f"image {image.image_id} of the run has no camera matrix",
                found="an orthographic camera" if camera else "no perspective camera of its size",
                expected="a run of scenes with perspective cameras, made with --track",
            )
        yield _Photo(
            image=image,
            size_wh=image.size_wh,
            intrinsics=[[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]],
            predictions=by_image.get(image.image_id, []),
        )


def _omni3d(run: Run, photos: list[_Photo], names: Mapping[int, str]) -> Any:
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for photo in photos:
        width, height = photo.size_wh
        images.append(
            {
                "id": photo.image.image_id,
                "dataset_id": 0,
                "width": width,
                "height": height,
                "file_name": photo.image.file_name,
                "file_path": photo.image.file_name,
                "K": photo.intrinsics,
                "src_90_rotate": 0,
                "src_flagged": False,
            }
        )
        for one in photo.predictions:
            annotation = _annotation(one, photo, names[one.category_id])
            annotations.append({"id": len(annotations) + 1, **annotation})
    return {
        "info": {"id": 0, "source": "legoworld", "name": run.task, "split": "", "version": "1"},
        "images": images,
        "categories": [{"id": i, "name": n, "supercategory": ""} for i, n in names.items()],
        "annotations": annotations,
    }


def _annotation(one: Prediction, photo: _Photo, name: str) -> dict[str, Any]:
    corners = _corners(one)
    center, axes, (length, height, width) = box_of_corners(corners)
    lines = lines_px(corners, photo.intrinsics)
    points = np.array(lines or [[_UNKNOWN] * 4]).reshape(-1, 2)
    x, y, w, h = extent_px(lines, photo.size_wh)
    return {
        "image_id": one.image_id,
        "dataset_id": 0,
        "category_id": one.category_id,
        "category_name": name,
        "valid3D": True,
        "bbox2D_proj": [*points.min(0).tolist(), *points.max(0).tolist()],
        "bbox2D_trunc": [x, y, x + w, y + h],
        "bbox2D_tight": [_UNKNOWN] * 4,
        "bbox3D_cam": corners.tolist(),
        "center_cam": center.tolist(),
        "dimensions": [width, height, length],
        "R_cam": axes.tolist(),
        "behind_camera": bool((corners[:, 2] <= 0).any()),
        "visibility": _known(one.visibility),
        "truncation": _known(one.truncation),
        "segmentation_pts": _UNKNOWN,
        "lidar_pts": _UNKNOWN,
        "depth_error": _UNKNOWN,
    }


def _labels(photo: _Photo, names: Mapping[int, str]) -> str:
    """KITTI's 15 columns: location is the centre of the bottom, ry turns about the camera's y."""
    lines = []
    for one in photo.predictions:
        corners = _corners(one)
        center, axes, (length, height, width) = box_of_corners(corners)
        x, y, z = (center + axes[:, 1] * (height / 2)).tolist()
        ry = math.atan2(-axes[2, 0], axes[0, 0])
        alpha = math.remainder(ry - math.atan2(x, z), math.tau)
        left, top, w, h = extent_px(lines_px(corners, photo.intrinsics), photo.size_wh)
        seen, cut = _known(one.visibility), _known(one.truncation)
        occluded = 3 if seen < 0 else sum(seen < least for least in KITTI_OCCLUSION)
        numbers = (alpha, left, top, left + w, top + h, height, width, length, x, y, z, ry)
        name = names[one.category_id].replace(" ", "_")
        lines.append(" ".join([name, f"{cut:.6f}", str(occluded), *(f"{v:.6f}" for v in numbers)]))
    return "".join(f"{line}\n" for line in lines)


def _calib(photo: _Photo) -> str:
    camera = " ".join(f"{v:.12e}" for row in photo.intrinsics for v in (*row, 0.0))
    one = " ".join(f"{v:.12e}" for v in np.eye(3).ravel())
    rigid = " ".join(f"{v:.12e}" for v in np.eye(3, 4).ravel())
    rows = [f"P{k}: {camera}" for k in range(4)] + [f"R0_rect: {one}"]
    return "\n".join([*rows, f"Tr_velo_to_cam: {rigid}", f"Tr_imu_to_velo: {rigid}"]) + "\n"


def _corners(one: Prediction) -> NDArray[np.float64]:
    return np.array(one.corners, np.float64)


def _axes(one: Prediction) -> NDArray[np.float64]:
    return box_of_corners(_corners(one))[1]


def _known(share: float | UnsetType | None) -> float:
    """A share; -1 where it is unknown, as in both formats."""
    return float(share) if isinstance(share, int | float) else float(_UNKNOWN)
