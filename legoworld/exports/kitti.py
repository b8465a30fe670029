"""Boxes in space as KITTI's object labels: label_2, calib and image_2. Metres and radians.

K has the centre of the first pixel at (0.5, 0.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.exports.formats import ExportResult
from legoworld.exports.view import ExportedView, write_image
from legoworld.files import write_text
from legoworld.readouts.boxes3d import box3d_exports
from legoworld.records.base import UnsetType
from legoworld.records.predictions import Prediction
from legoworld.visibility.cuboids import extent_px, lines_px, measure_cuboid

#: KITTI's `occluded` by the share that nothing hides: 0 from the first on, 1 from the second on.
OCCLUSION: Final = (0.9, 0.5)
UNKNOWN: Final = -1
#: From this tilt on, it is said what is lost.
_LEVEL_DEG: Final = 0.5

Named = tuple[str, Prediction]
Matrix = Sequence[Sequence[float]] | NDArray[np.float64]


def write_views(views: Iterable[ExportedView], output: Path) -> ExportResult:
    """Write label_2, calib and, where a scene has its picture, image_2; numbered from 0."""
    written: list[Named] = []
    images = 0
    for number, view in enumerate(views):
        images, k = number + 1, view.intrinsics("KITTI")
        exports = box3d_exports(number, view.grouping.instances, view.view)
        named = [(one.category.name, box) for box, one in exports if one.category is not None]
        write_files(output, f"{number:06d}.txt", named, k, view.view.size_wh)
        picture = view.picture()
        if picture is not None:
            write_image(output / "image_2" / f"{number:06d}.png", picture)
        written += named
    return ExportResult(images=images, annotations=len(written), losses=losses(written))


def write_files(
    output: Path, name: str, boxes: Sequence[Named], k: Matrix, size_wh: tuple[int, int]
) -> None:
    """Write the label and the calibration of one image. k: (3, 3) in pixels."""
    for folder, text in (("label_2", _labels(boxes, k, size_wh)), ("calib", _calibration(k))):
        path = output / folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)


def losses(boxes: Sequence[Named]) -> tuple[str, ...]:
    """What the 15 columns cannot hold of these boxes."""
    axes = [measure_cuboid(box_corners(box))[1] for _, box in boxes]
    tilt = max((math.degrees(math.acos(min(abs(float(a[1, 1])), 1.0))) for a in axes), default=0.0)
    lost = []
    if tilt > _LEVEL_DEG:
        lost.append(
            f"KITTI's boxes turn about the camera's vertical alone: up to {tilt:.1f} degrees of "
            "tilt are lost; omni3d keeps them"
        )
    spaced = sorted({name for name, _ in boxes if " " in name})
    if spaced:
        lost.append(f"spaces in category names became _: {', '.join(spaced)}")
    return tuple(lost)


def _labels(boxes: Sequence[Named], k: Matrix, size_wh: tuple[int, int]) -> str:
    """KITTI's 15 columns: location is the centre of the bottom, ry turns about the camera's y."""
    intrinsics = np.asarray(k, np.float64).tolist()
    lines = []
    for name, one in boxes:
        corners = box_corners(one)
        center, axes, (length, height, width) = measure_cuboid(corners)
        x, y, z = (center + axes[:, 1] * (height / 2)).tolist()
        ry = math.atan2(-axes[2, 0], axes[0, 0])
        alpha = math.remainder(ry - math.atan2(x, z), math.tau)
        left, top, w, h = extent_px(lines_px(corners, intrinsics), size_wh)
        seen, cut = share_or_unknown(one.visibility), share_or_unknown(one.truncation)
        occluded = 3 if seen < 0 else sum(seen < least for least in OCCLUSION)
        numbers = (alpha, left, top, left + w, top + h, height, width, length, x, y, z, ry)
        columns = [name.replace(" ", "_"), f"{cut:.6f}", str(occluded)]
        lines.append(" ".join([*columns, *(f"{v:.6f}" for v in numbers)]))
    return "".join(f"{line}\n" for line in lines)


def _calibration(k: Matrix) -> str:
    camera = " ".join(f"{v:.12e}" for row in k for v in (*row, 0.0))
    one = " ".join(f"{v:.12e}" for v in np.eye(3).ravel())
    rigid = " ".join(f"{v:.12e}" for v in np.eye(3, 4).ravel())
    rows = [f"P{k}: {camera}" for k in range(4)] + [f"R0_rect: {one}"]
    return "\n".join([*rows, f"Tr_velo_to_cam: {rigid}", f"Tr_imu_to_velo: {rigid}"]) + "\n"


def box_corners(one: Prediction) -> NDArray[np.float64]:
    """(8, 3) corners of a box in space."""
    return np.array(one.corners, np.float64)


def share_or_unknown(share: float | UnsetType | None) -> float:
    """A share; -1 where it is unknown, as in KITTI and Omni3D."""
    return float(share) if isinstance(share, int | float) else float(UNKNOWN)
