"""Relative depth of a photo: an array of any provider, at the photo's size."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

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


def write_depth(given: GivenDepth, size_wh: tuple[int, int], output: Path) -> DepthEvidence:
    """Write depth.npz at the photo's size. EvidenceInvalidError for what is no depth of it."""
    path = given.path
    values = _array(path)
    if values.shape != size_wh[::-1]:
        _refuse_another_shape(values.shape, size_wh, known=given.of_photo)
        values = _resized(values, size_wh)
    if np.count_nonzero(np.isfinite(values)) < 16:
        raise EvidenceInvalidError(
            f"{path.name} has no depth",
            found="fewer than 16 finite values",
            expected="depth",
        )
    write_npz(output / DEPTH, {"values": values})
    return DepthEvidence(
        sha256=sha256_of_file(output / DEPTH),
        space=given.space,
        source=given.source,
    )


def _array(path: Path) -> NDArray[np.float32]:
    """(H, W) float32 of a .npy, a .npz (its `values` or `depth_z_m`, or its only array), a .png."""
    try:
        if path.suffix.lower() == ".png":
            import cv2

            picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            if picture is None:
                raise ValueError("no PNG")
            array = np.asarray(picture)
        else:
            with path.open("rb") as stream:
                loaded = np.load(stream, allow_pickle=False)
                array = loaded if isinstance(loaded, np.ndarray) else _only(loaded)
        if array.ndim != 2:
            raise ValueError(f"an array of shape {array.shape}")
        return np.asarray(array, np.float32)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise EvidenceInvalidError(
            f"{path.name} cannot be read as depth",
            found=str(error),
            expected="a .npy, .npz or .png of one (H, W) array",
        ) from error


def _only(loaded: Any) -> NDArray[Any]:
    for name in ("values", "depth_z_m"):
        if name in loaded:
            return np.asarray(loaded[name])
    if len(loaded.files) != 1:
        raise ValueError(f"{len(loaded.files)} arrays, none called values or depth_z_m")
    return np.asarray(loaded[loaded.files[0]])


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


def _resized(values: NDArray[np.float32], size_wh: tuple[int, int]) -> NDArray[np.float32]:
    """To the photo's size, by nearest neighbours: no depth is made up between two surfaces."""
    import cv2

    return np.asarray(cv2.resize(values, size_wh, interpolation=cv2.INTER_NEAREST), np.float32)
