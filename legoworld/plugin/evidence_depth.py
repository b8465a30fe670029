"""Relative depth of a photo: an array of any provider, at the photo's size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import picture_shape
from legoworld.depth_files.read_depth import npz_contents, read_npz_array, read_picture
from legoworld.errors import cause
from legoworld.files import sha256_of_file, write_npz
from legoworld.plugin.evidence import DEPTH, EvidenceInvalidError
from legoworld.records.plugin_evidence import DepthEvidence, DepthSpace


@dataclass(frozen=True, kw_only=True)
class GivenDepth:
    """An array of a photo, and what it is. source: who made it.

    of_photo: it is known to show all of this photo, by a run's hashes; then its grid may have
    another aspect than the photo, as networks' have.
    """

    path: Path
    space: DepthSpace
    source: str
    of_photo: bool


#: Sides of a network's array are multiples of about 14: the scorer's own limit of its aspect.
_GRID_TOLERANCE: Final = 0.05


def write_depth(given_depth: GivenDepth, size_wh: tuple[int, int], output: Path) -> DepthEvidence:
    """Write depth.npz at the photo's size. EvidenceInvalidError if it is not depth of the photo."""
    path = given_depth.path
    values = _array(path)
    if values.shape != size_wh[::-1]:
        _refuse_another_shape(values.shape, size_wh, known=given_depth.of_photo)
        values = _resize_depth(values, size_wh)
    if np.count_nonzero(np.isfinite(values)) < 16:
        raise EvidenceInvalidError(
            f"{path} has no depth",
            found="fewer than 16 finite values",
            expected="depth",
        )
    write_npz(output / DEPTH, {"values": values})
    return DepthEvidence(
        sha256=sha256_of_file(output / DEPTH),
        space=given_depth.space,
        source=given_depth.source,
    )


def _array(path: Path) -> NDArray[np.float32]:
    """(H, W) float32 of a depth file; of a .npz its `values` or `depth_z_m`, or its only array."""
    try:
        if path.suffix.lower() == ".npz":
            array = read_npz_array(path, _only(path), None)
        else:
            array, _ = read_picture(path)
        array = array.reshape(picture_shape(array.shape))
        if array.ndim != 2 or array.dtype.kind not in "fiu":
            raise ValueError(f"an array of {array.dtype} of shape {array.shape}")
        with np.errstate(over="ignore"):  # beyond float32: infinite, not a depth
            return np.asarray(array, np.float32)
    except (OSError, ValueError, MemoryError, DepthFileError) as error:
        raise EvidenceInvalidError(
            f"{path} cannot be read as depth",
            found=cause(error),
            expected="one (H, W) array, in any depth format or the only one of a .npz",
        ) from error


def _only(path: Path) -> str:
    names = npz_contents(path, ()).names
    for name in ("values", "depth_z_m"):
        if name in names:
            return name
    if len(names) != 1:
        raise ValueError(f"{len(names)} arrays, none called values or depth_z_m")
    return names[0]


def _refuse_another_shape(shape: tuple[int, ...], size_wh: tuple[int, int], *, known: bool) -> None:
    (height, width), expected = shape, size_wh[1] * shape[1] / size_wh[0]
    away = abs(height - expected)
    if known:
        same = away <= max(1.0, _GRID_TOLERANCE * expected)
    else:  # the shape is all that tells whose array it is
        same = away * size_wh[0] <= max(width, height, *size_wh)
    if not same:
        raise EvidenceInvalidError(
            "the depth is of another photo",
            found=f"{width}x{height}",
            expected=f"{size_wh[0]}x{size_wh[1]}, or another size of that shape",
        )


def _resize_depth(values: NDArray[np.float32], size_wh: tuple[int, int]) -> NDArray[np.float32]:
    """To the photo's size, by nearest neighbours: no depth is made up between two surfaces."""
    import cv2

    return np.asarray(cv2.resize(values, size_wh, interpolation=cv2.INTER_NEAREST), np.float32)
