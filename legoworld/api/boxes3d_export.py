"""A run of boxes in space as Omni3D's JSON, which `evaluate` takes as truth, or KITTI's files.

Everything is taken from the corners, so imported boxes are exported as a scene's are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from legoworld.api.coco_export import run_vocabulary
from legoworld.errors import UsageError
from legoworld.evaluation.detection.payloads.boxes3d import BOXES3D
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.run import Run, RunUnusableError, read_predictions, read_run
from legoworld.exports import kitti
from legoworld.exports.formats import ExportResult
from legoworld.exports.kitti import UNKNOWN, box_corners, share_or_unknown
from legoworld.files import readable_json, write_text
from legoworld.records.base import decode
from legoworld.records.folders.read_run import RUN
from legoworld.records.predictions import Prediction
from legoworld.records.run_file import RunFile
from legoworld.records.run_rows import RunImage
from legoworld.visibility.cuboids import extent_px, lines_px, measure_cuboid


@dataclass(frozen=True, kw_only=True)
class _Photo:
    image: RunImage
    size_wh: tuple[int, int]
    intrinsics: list[list[float]]
    predictions: list[Prediction]


def write_omni3d(run_folder: Path, output: Path, *, track: Path | None) -> ExportResult:
    """Write a run of boxes in space as one JSON in Omni3D's form.

    Raises UsageError for runs of other tasks, RunUnusableError for a run without cameras (an
    import); nothing is written then.
    """
    run, photos, names = _read(run_folder, track)
    write_text(output, readable_json(_omni3d(run, photos, names)))
    return ExportResult(images=len(photos), annotations=sum(len(p.predictions) for p in photos))


def write_kitti(run_folder: Path, output: Path, *, track: Path | None) -> ExportResult:
    """Write a run of boxes in space as KITTI's labels; raises as `write_omni3d` does."""
    _, photos, names = _read(run_folder, track)
    boxes: list[kitti.Named] = []
    for photo in photos:
        named = [(names[one.category_id], one) for one in photo.predictions]
        file = str(PurePosixPath(photo.image.file_name).with_suffix(".txt"))
        kitti.write_files(output, file, named, photo.intrinsics, photo.size_wh)
        boxes += named
    return ExportResult(images=len(photos), annotations=len(boxes), losses=kitti.losses(boxes))


def _read(run_folder: Path, track: Path | None) -> tuple[Run, list[_Photo], dict[int, str]]:
    run = read_run(run_folder)
    if detection_protocol(run.task).payload is not BOXES3D:
        raise UsageError(
            f"a run of {run.task} has no boxes in space",
            expected="a run of boxes in space",
            next_step="pass --format coco",
        )
    vocabulary = run_vocabulary(run, track)
    return run, list(_photos(run)), {c.id: c.name for c in vocabulary.categories}


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
    corners = box_corners(one)
    center, axes, (length, height, width) = measure_cuboid(corners)
    lines = lines_px(corners, photo.intrinsics)
    points = np.array(lines or [[UNKNOWN] * 4]).reshape(-1, 2)
    x, y, w, h = extent_px(lines, photo.size_wh)
    return {
        "image_id": one.image_id,
        "dataset_id": 0,
        "category_id": one.category_id,
        "category_name": name,
        "valid3D": True,
        "bbox2D_proj": [*points.min(0).tolist(), *points.max(0).tolist()],
        "bbox2D_trunc": [x, y, x + w, y + h],
        "bbox2D_tight": [UNKNOWN] * 4,
        "bbox3D_cam": corners.tolist(),
        "center_cam": center.tolist(),
        "dimensions": [width, height, length],
        "R_cam": axes.tolist(),
        "behind_camera": bool((corners[:, 2] <= 0).any()),
        "visibility": share_or_unknown(one.visibility),
        "truncation": share_or_unknown(one.truncation),
        "segmentation_pts": UNKNOWN,
        "lidar_pts": UNKNOWN,
        "depth_error": UNKNOWN,
    }
