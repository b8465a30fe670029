"""Views in the layout of Replicator's BasicWriter: files of one frame end in its number. Metres.

Boxes are pixel indices, both ends included. Segmentations are colours (RGBA), each named in the
JSON beside the picture.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.exports.formats import ExportResult
from legoworld.exports.view import ExportedView, write_image
from legoworld.files import Json, write_text
from legoworld.scene.instances import Instance
from legoworld.visibility.amodal import Amodal

BOX_2D: Final = np.dtype(
    [("semanticId", "<u4"), ("x_min", "<i4"), ("y_min", "<i4"), ("x_max", "<i4"),
     ("y_max", "<i4"), ("occlusionRatio", "<f4")],
)  # fmt: skip
#: Colours of pixels without a hit, and of surfaces without a label.
BACKGROUND: Final = (0, 0, 0, 0)
UNLABELLED: Final = (0, 0, 0, 255)
#: Odd, so that products modulo 2^24 are a permutation: no two instances share a colour.
_SPREAD: Final = 0x9E3779

Color = tuple[int, int, int, int]


def write_views(views: Iterable[ExportedView], output: Path) -> ExportResult:
    """Write the frames, numbered from 0. UsageError for an orthographic camera."""
    output.mkdir()
    images = annotations = without_picture = 0
    for number, view in enumerate(views):
        picture = view.picture()
        if picture is not None:
            write_image(output / f"rgb_{number:04d}.png", picture)
        _write_depth(output, number, view)
        annotations += _write_boxes(output, number, view)
        _write_segmentations(output, number, view)
        _write_json(output, "camera_params", number, _camera(view))
        images, without_picture = number + 1, without_picture + (picture is None)
    lost = ["instances have names of objects in the place of prim paths"]
    if without_picture:
        lost.append(f"no rgb of {without_picture} of {images} frames: no final.png of their size")
    return ExportResult(images=images, annotations=annotations, losses=tuple(lost))


def _write_depth(output: Path, number: int, view: ExportedView) -> None:
    """Planar depth and distance from the camera, (H, W) float32; inf where nothing is hit."""
    depth = view.view.buffers.depth_z_m
    rays = view.rays("Replicator's layout")
    _write_npy(output, "distance_to_image_plane", number, depth)
    _write_npy(output, "distance_to_camera", number, (depth * rays).astype(np.float32))


def _write_boxes(output: Path, number: int, view: ExportedView) -> int:
    """Tight boxes of what is visible, loose ones of all that is in the frame; how many of these."""
    amodal, labelled = view.view.amodal(), view.labelled()
    names = sorted({_class(one) for one in labelled})
    tight = [i for i in labelled if view.view.area_px[i.id]]
    loose = [i for i in labelled if amodal.in_frame_px[i.id]]
    extents = view.view.bbox_xyxy_px
    masks = (amodal.layers.mask(i.id) for i in loose)
    boxes = {
        "tight": (tight, [extents[i.id].tolist() for i in tight]),
        "loose": (loose, [_extent(mask) for mask in masks]),
    }
    for kind, (instances, corners) in boxes.items():
        rows = np.array(
            [
                (names.index(_class(i)), x0, y0, x1 - 1, y1 - 1, _occlusion(view, amodal, i))
                for i, (x0, y0, x1, y1) in zip(instances, corners, strict=True)
            ],
            BOX_2D,
        )
        file = f"bounding_box_2d_{kind}"
        labels = {str(k): {"class": name} for k, name in enumerate(names)}
        _write_npy(output, file, number, rows)
        _write_json(output, f"{file}_labels", number, labels)
        _write_json(output, f"{file}_prim_paths", number, _paths(instances))
    return len(loose)


def _occlusion(view: ExportedView, amodal: Amodal, instance: Instance) -> float:
    """The share of an instance's pixels in the frame that others hide."""
    return 1 - float(view.view.area_px[instance.id] / amodal.in_frame_px[instance.id])


def _write_segmentations(output: Path, number: int, view: ExportedView) -> None:
    shown = view.view.buffers.instance
    labelled = [i for i in view.labelled() if view.view.area_px[i.id]]
    names = sorted({_class(one) for one in labelled})
    kinds = {
        "semantic_segmentation": {i.id: names.index(_class(i)) for i in labelled},
        "instance_segmentation": {i.id: at for at, i in enumerate(labelled)},
    }
    for kind, place in kinds.items():
        colors = np.array([UNLABELLED] * len(view.grouping.instances) + [BACKGROUND], np.uint8)
        for instance_id, at in place.items():
            colors[instance_id] = color(at)
        write_image(output / f"{kind}_{number:04d}.png", colors[shown])
    rest = {str(BACKGROUND): "BACKGROUND", str(UNLABELLED): "UNLABELLED"}
    classes = {str(color(at)): name for at, name in enumerate(names)}
    paths = {str(color(at)): p for at, p in enumerate(_paths(labelled))}
    semantics = {str(color(at)): _class(i) for at, i in enumerate(labelled)}
    mapped: dict[str, Json] = {
        "semantic_segmentation_labels": _classes(rest | classes),
        "instance_segmentation_mapping": rest | paths,
        "instance_segmentation_semantics_mapping": _classes(rest | semantics),
    }
    for name, value in mapped.items():
        _write_json(output, name, number, value)


def color(number: int) -> Color:
    """The colour of the nth class or instance."""
    value = (number + 1) * _SPREAD % 2**24
    return value & 0xFF, value >> 8 & 0xFF, value >> 16, 255


def _camera(view: ExportedView) -> dict[str, Any]:
    """Pose and lens as Omniverse has them: y up, looking along -z, matrices for row vectors."""
    k, (width, height) = view.intrinsics("Replicator's layout"), view.view.size_wh
    focal_mm = view.snapshot.camera.lens_mm
    flipped = np.diag([1.0, -1.0, -1.0, 1.0])
    view_from_world = flipped @ np.linalg.inv(view.world_from_cam_m())
    offset = [(width / 2 - k[0, 2]) / k[0, 0], (k[1, 2] - height / 2) / k[1, 1]]
    camera = view.snapshot.camera
    return {
        "cameraModel": "pinhole",
        "cameraFocalLength": focal_mm,
        "cameraAperture": [width / k[0, 0] * focal_mm, height / k[1, 1] * focal_mm],
        "cameraApertureOffset": [value * focal_mm for value in offset],
        "cameraNearFar": [z * view.view.depth_scale for z in (camera.clip_start, camera.clip_end)],
        "cameraViewTransform": view_from_world.T.ravel().tolist(),
        "metersPerSceneUnit": 1.0,
        "renderProductResolution": [width, height],
    }


def _class(instance: Instance) -> str:
    assert instance.category is not None
    return instance.category.name


def _classes(names: Mapping[str, str]) -> dict[str, dict[str, str]]:
    return {key: {"class": name} for key, name in names.items()}


def _paths(instances: Sequence[Instance]) -> list[str]:
    return [f"/{one.id}/{one.name}" for one in instances]


def _extent(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _write_npy(output: Path, name: str, number: int, array: NDArray[Any]) -> None:
    with (output / f"{name}_{number:04d}.npy").open("wb") as stream:
        np.save(stream, array)


def _write_json(output: Path, name: str, number: int, value: Json) -> None:
    write_text(output / f"{name}_{number:04d}.json", json.dumps(value) + "\n")
