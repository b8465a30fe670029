"""Views as a BOP dataset: one folder of test/ a scene, one image a view. Millimetres.

Frames: OpenCV's camera, the scene's world, and for each model its object's own axes around the
centre of its box. cam_K has the centre of the first pixel at (0, 0), as the depth code of
bop_toolkit and BlenderProc's BopWriter have it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.exports.bop_models import BopModels
from legoworld.exports.formats import ExportResult
from legoworld.exports.view import ExportedView, write_image
from legoworld.files import readable_json, write_text
from legoworld.pluralize import plural
from legoworld.visibility.amodal import Amodal, Silhouette
from legoworld.visibility.kernel import render

#: How far behind the measured surface the official rule calls a pixel visible, millimetres.
DELTA_MM: Final = 15.0
#: Sides of the canvas on which the official rule counts a whole silhouette, in pictures.
CANVAS: Final = 3
#: The least `visib_fract` of an evaluation target.
TARGET_VISIBILITY: Final = 0.1
#: Millimetres of a step of a depth picture: the first that holds the farthest pixel is taken.
DEPTH_STEPS_MM: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 1000.0)
_MOST: Final = 2**16 - 1
_NO_BOX: Final = [-1, -1, -1, -1]
_MM: Final = 1000.0

Mask = NDArray[np.bool_]


def write_views(views: Iterable[ExportedView], output: Path) -> ExportResult:
    """Write test/, models/, camera.json and test_targets_bop19.json.

    Every labelled instance with an amodal pixel in the frame has a pose. UsageError for an
    orthographic camera.
    """
    models = BopModels(output / "models")
    targets: list[dict[str, int]] = []
    images = annotations = 0
    steps: set[float] = set()
    without_picture = 0
    for scene_id, (_, group) in enumerate(groupby(views, key=lambda view: view.scene), start=1):
        folder = output / "test" / f"{scene_id:06d}"
        tables: dict[str, dict[str, Any]] = {"camera": {}, "gt": {}, "gt_info": {}}
        for im_id, view in enumerate(group):
            image = _BopImage(view)
            poses, infos = image.write(folder, im_id, models, scene_id)
            values = (image.camera(), poses, infos)
            for table, value in zip(tables.values(), values, strict=True):
                table[str(im_id)] = value
            objects = [pose["obj_id"] for pose in poses]
            visible = [info["visib_fract"] for info in infos]
            targets += _targets(scene_id, im_id, objects, visible)
            if not images:
                write_text(output / "camera.json", readable_json(image.sensor()))
            images, annotations = images + 1, annotations + len(poses)
            steps.add(image.step_mm)
            without_picture += image.picture is None
        for name, table in tables.items():
            write_text(folder / f"scene_{name}.json", readable_json(table))
    write_text(output / "test_targets_bop19.json", readable_json(targets))
    models.write_info()
    lost = [f"depth is rounded to {max(steps, default=0.1):g} mm", *models.losses()]
    if without_picture:
        count = plural(without_picture, "image", "images")
        lost.append(f"no rgb of {count}: no final.png of its size")
    return ExportResult(images=images, annotations=annotations, losses=tuple(lost))


def visible_bop19(measured_mm: NDArray[Any], model_mm: NDArray[Any]) -> Mask:
    """BOP's official visibility: at most DELTA_MM behind what was measured, or nothing measured.

    Both: (H, W) distances in millimetres from the camera, 0 where there is nothing; compared as
    float32, as there.
    """
    behind = model_mm.astype(np.float32) - measured_mm.astype(np.float32)
    return np.asarray(((behind <= DELTA_MM) | (measured_mm == 0)) & (model_mm > 0))


class _BopImage:
    """One view, with its depth as it is stored. step_mm: of a depth picture."""

    def __init__(self, view: ExportedView) -> None:
        self._view = view
        self._k = view.intrinsics("BOP")
        self._k[:2, 2] -= 0.5
        self._rays = view.rays("BOP")
        depth_m = view.view.buffers.depth_z_m
        depth_mm = np.where(np.isfinite(depth_m), depth_m, 0).astype(np.float64) * _MM
        fits = (step for step in DEPTH_STEPS_MM if depth_mm.max(initial=0) <= step * _MOST)
        self.step_mm = next(fits, DEPTH_STEPS_MM[-1])
        # Nothing nearer than half a step may become 0, which is "not measured".
        steps = np.clip(np.rint(depth_mm / self.step_mm), depth_mm > 0, _MOST)
        self._depth = steps.astype(np.uint16)
        self.picture = view.picture()

    def camera(self) -> dict[str, Any]:
        """The entry of scene_camera.json."""
        cam_from_world = np.linalg.inv(self._view.world_from_cam_m())
        return {
            "cam_K": self._k.ravel().tolist(),
            "depth_scale": self.step_mm,
            "cam_R_w2c": cam_from_world[:3, :3].ravel().tolist(),
            "cam_t_w2c": (cam_from_world[:3, 3] * _MM).tolist(),
        }

    def sensor(self) -> dict[str, float]:
        """camera.json."""
        width, height = self._view.view.size_wh
        fx, fy, cx, cy = self._k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        intrinsics = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
        return {**intrinsics, "depth_scale": self.step_mm, "width": width, "height": height}

    def write(
        self, folder: Path, im_id: int, models: BopModels, scene_id: int
    ) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """Write the pictures; the entries of scene_gt.json and scene_gt_info.json."""
        view = self._view
        write_image(folder / "depth" / f"{im_id:06d}.png", self._depth)
        if self.picture is not None:
            write_image(folder / "rgb" / f"{im_id:06d}.png", self.picture)
        amodal = view.view.amodal()
        exported = [i for i in view.labelled() if amodal.in_frame_px[i.id]]
        whole = amodal.silhouettes([i.id for i in exported])
        measured = (self._depth * np.float64(self.step_mm) * self._rays).astype(np.float32)
        poses, infos = [], []
        for gt_id, (instance, silhouette) in enumerate(zip(exported, whole, strict=True)):
            alone_mm = self._distance_alone(amodal, instance.id)
            masks = {
                "mask": alone_mm > 0,
                "mask_visib": visible_bop19(measured, alone_mm),
                "mask_visib_exact": view.view.buffers.instance == instance.id,
            }
            for name, mask in masks.items():
                file = folder / name / f"{im_id:06d}_{gt_id:06d}.png"
                write_image(file, mask.astype(np.uint8) * np.uint8(255))
            assert instance.category is not None
            placed = models.place(scene_id, view.view, instance)
            poses.append({**placed, "name": instance.name, "category": instance.category.name})
            infos.append(self._info(instance.id, masks, measured > 0, silhouette))
        return poses, infos

    def _distance_alone(self, amodal: Amodal, instance_id: int) -> NDArray[np.float32]:
        """(H, W) distance of an instance drawn alone, millimetres; 0 where it is not."""
        layers = amodal.layers
        entries = np.flatnonzero(layers.instance == instance_id)
        pixels = np.searchsorted(layers.start, entries, side="right") - 1
        depth = np.zeros(self._rays.size)
        depth[pixels] = layers.depth_z_m[entries] * _MM
        return (depth.reshape(self._rays.shape) * self._rays).astype(np.float32)

    def _info(
        self, instance_id: int, masks: Mapping[str, Mask], measured: Mask, exact: Silhouette
    ) -> dict[str, Any]:
        """What calc_gt_info.py of bop_toolkit counts; beside it, what is exact."""
        inside, visible = masks["mask"], masks["mask_visib"]
        canvas, corner = inside, (0, 0)
        if exact.whole_px != exact.in_frame_px:
            canvas, corner = self._on_canvas(instance_id)
        whole_px, seen_px = int(canvas.sum()), int(visible.sum())
        return {
            "px_count_all": whole_px,
            "px_count_valid": int((inside & measured).sum()),
            "px_count_visib": seen_px,
            "visib_fract": seen_px / whole_px if whole_px else 0.0,
            "bbox_obj": _box(canvas, corner) if seen_px else _NO_BOX,
            "bbox_visib": _box(visible, (0, 0)) if seen_px else _NO_BOX,
            "exact": {
                "visible_px": exact.visible_px,
                "in_frame_px": exact.in_frame_px,
                "whole_px": exact.whole_px,
                "visible_of_in_frame": exact.visible_of_in_frame,
                "in_frame_of_whole": exact.in_frame_of_whole,
                "visible_of_whole": exact.visible_of_whole,
            },
        }

    def _on_canvas(self, instance_id: int) -> tuple[Mask, tuple[int, int]]:
        """The silhouette on the larger canvas, and the place of the picture's corner in it."""
        surfaces, camera = self._view.view.surfaces, self._view.view.projection
        own = np.flatnonzero(surfaces.placement_id == instance_id)
        alone = replace(
            surfaces,
            placement_mesh=surfaces.placement_mesh[own],
            cam_from_mesh=surfaces.cam_from_mesh[own],
            placement_id=surfaces.placement_id[own],
        )
        width, height = self._view.view.size_wh
        moved = replace(camera, cx=camera.cx + width, cy=camera.cy + height)
        shown = render(alone, moved, (CANVAS * width, CANVAS * height)).instance >= 0
        return shown, (width, height)


def _box(mask: Mask, corner: tuple[int, int]) -> list[int]:
    """BOP's box of a mask: the first column and row, and how far the last ones are from them.

    One less than the number of columns and rows: so calc_2d_bbox of bop_toolkit counts.
    """
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    x, y = int(columns[0]), int(rows[0])
    return [x - corner[0], y - corner[1], int(columns[-1]) - x, int(rows[-1]) - y]


def _targets(
    scene_id: int, im_id: int, objects: Sequence[int], visible: Sequence[float]
) -> list[dict[str, int]]:
    counts = Counter(
        obj_id for obj_id, share in zip(objects, visible, strict=True) if share >= TARGET_VISIBILITY
    )
    return [
        {"im_id": im_id, "inst_count": count, "obj_id": obj_id, "scene_id": scene_id}
        for obj_id, count in sorted(counts.items())
    ]
