"""A view as one scene of a BOP dataset: models, poses, masks and depth, in millimetres.

A pixel's centre is at integer coordinates there, so K's principal point is half a pixel less.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.errors import UsageError
from legoworld.evaluation.pose.errors import Model, Photo, drawn_depth, visible_to_bop
from legoworld.files import Json, atomic_path, readable_json, write_text
from legoworld.readouts.boxes3d import Box3d, InstancePoints, fit_boxes, intrinsics_of
from legoworld.visibility.view import View

Floats = NDArray[np.float64]
_MM: Final = 1000.0
#: Depth of a 16-bit picture's unit where that reaches far enough, millimetres.
_DEPTH_UNIT_MM: Final = 0.1
_MOST: Final = 65535


def write_bop(view: View, ids: Sequence[int], names: Sequence[str], folder: Path) -> None:
    """models/ and test/000001/ of instances; objects are numbered from 1 in their order.

    A model's frame is that of its upright box. visib_fract is BOP's own: pixels that lie at most
    15 mm behind what the picture shows, of those on three pictures' width and height; visible_share
    and in_frame_share are the exact ones. UsageError for an orthographic camera or existing files.
    """
    if view.projection.orthographic:
        raise UsageError("BOP has no orthographic cameras", expected="a perspective camera")
    scene = folder / "test" / "000001"
    if scene.exists():
        raise UsageError(f"{scene} already exists", next_step="choose another folder")
    for part in ("depth", "mask", "mask_visib"):
        (scene / part).mkdir(parents=True)
    (folder / "models").mkdir()
    k = np.array(intrinsics_of(view.projection), np.float64)
    k[:2, 2] -= 0.5
    depth = np.where(np.isfinite(view.buffers.depth_z_m), view.buffers.depth_z_m, 0) * _MM
    photo = Photo(intrinsics=k, depth_mm=depth.astype(np.float64))
    unit = max(_DEPTH_UNIT_MM, float(depth.max(initial=0)) / _MOST)
    _write_png(scene / "depth" / "000000.png", np.rint(depth / unit).astype(np.uint16))
    points, layers = InstancePoints(view.surfaces, view.depth_scale), view.amodal().layers
    models: dict[str, Any] = {}
    poses, infos = [], []
    for n, (box, name) in enumerate(zip(fit_boxes(view, ids), names, strict=True), start=1):
        vertices, triangles = points.mesh_of(box.instance_id)
        local = (vertices - box.center_m) @ box.axes * _MM
        models[str(n)] = {"name": name, **_extent(local)}
        model = Model(
            vertices=local.astype(np.float32),
            triangles=triangles,
            diameter=models[str(n)]["diameter"],
            symmetries=np.eye(3, 4)[None],
        )
        _write_ply(folder / "models" / f"obj_{n:06}.ply", model)
        visible = view.buffers.instance == box.instance_id
        for part, mask in (("mask", layers.mask(box.instance_id)), ("mask_visib", visible)):
            path = scene / part / f"000000_{n - 1:06}.png"
            _write_png(path, mask.astype(np.uint8) * 255)
        rotation, place = box.axes.ravel().tolist(), (box.center_m * _MM).tolist()
        poses.append({"cam_R_m2c": rotation, "cam_t_m2c": place, "obj_id": n})
        infos.append(_gt_info(box, model, photo, visible))
    _write_json(folder / "models" / "models_info.json", models)
    _write_json(scene / "scene_gt.json", {"0": poses})
    _write_json(scene / "scene_gt_info.json", {"0": infos})
    camera = {"cam_K": k.ravel().tolist(), "depth_scale": unit}
    _write_json(scene / "scene_camera.json", {"0": camera})
    width, height = view.size_wh
    flat = {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2], "depth_scale": unit}
    _write_json(folder / "camera.json", {**flat, "width": width, "height": height})


def _gt_info(box: Box3d, model: Model, photo: Photo, visible: NDArray[np.bool_]) -> Any:
    """BOP's counts, with their canvas and tolerance, and the exact shares."""
    height, width = photo.depth_mm.shape
    k = photo.intrinsics + np.array([[0, 0, width], [0, 0, height], [0, 0, 0]])
    canvas = Photo(intrinsics=k, depth_mm=np.zeros((3 * height, 3 * width)))
    drawn = drawn_depth(model, pose_mm(box), canvas)
    inside = drawn[height : 2 * height, width : 2 * width]
    seen = visible_to_bop(photo, inside)
    n_all = int((drawn > 0).sum())
    return {
        "bbox_obj": _bbox(drawn > 0, (width, height)),
        "bbox_visib": _bbox(seen),
        "px_count_all": n_all,
        "px_count_valid": int(((inside > 0) & (photo.depth_mm > 0)).sum()),
        "px_count_visib": int(seen.sum()),
        "visib_fract": int(seen.sum()) / n_all if n_all else 0.0,
        "px_visible_exact": int(visible.sum()),
        "visible_share": box.visibility,
        "in_frame_share": box.silhouette.in_frame_of_whole,
    }


def pose_mm(box: Box3d) -> Floats:
    """(3, 4) camera from the box's own frame, millimetres."""
    return np.column_stack([box.axes, box.center_m * _MM])


def _bbox(mask: NDArray[np.bool_], origin: tuple[int, int] = (0, 0)) -> list[int]:
    """x, y and last minus first pixel, as BOP has them; -1 for none."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return [-1, -1, -1, -1]
    x, y = int(columns[0]) - origin[0], int(rows[0]) - origin[1]
    return [x, y, int(columns[-1] - columns[0]), int(rows[-1] - rows[0])]


def _extent(points: Floats) -> dict[str, float]:
    """Bounds, and the diameter: the largest distance of two points of the hull."""
    low, high = points.min(axis=0), points.max(axis=0)
    named = {f"min_{a}": float(v) for a, v in zip("xyz", low, strict=True)}
    named |= {f"size_{a}": float(v) for a, v in zip("xyz", high - low, strict=True)}
    return {"diameter": _diameter(points), **named}


def _diameter(points: Floats) -> float:
    from scipy.spatial import ConvexHull, QhullError

    try:
        corners = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        corners = np.unique(points, axis=0)
    largest = 0.0
    for point in corners:
        largest = max(largest, float(((corners - point) ** 2).sum(axis=1).max()))
    return float(np.sqrt(largest))


def _write_ply(path: Path, model: Model) -> None:
    vertices, triangles = model.vertices, model.triangles
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(triangles)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), np.dtype([("n", "u1"), ("v", "<i4", 3)]))
    faces["n"], faces["v"] = 3, triangles
    with atomic_path(path) as temporary:
        temporary.write_bytes(head.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())


def _write_png(path: Path, pixels: NDArray[Any]) -> None:
    with atomic_path(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())


def _write_json(path: Path, document: Json) -> None:
    write_text(path, readable_json(document))
