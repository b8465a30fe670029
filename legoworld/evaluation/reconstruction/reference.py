"""The reference's points of one case: at the raster's own centres, or out of full-size arrays."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.read_depth import npz_arrays
from legoworld.errors import UsageError, cause
from legoworld.evaluation.reconstruction.dataset import BenchCase, BenchFolders, BenchTruthError
from legoworld.evaluation.reconstruction.points import (
    F64,
    Depth,
    Labels,
    Raster,
    finite_points,
    picture_raster,
    points_m,
)
from legoworld.files import sha256_of_file
from legoworld.records.bench_dataset import ScoredObject

_RANDOM: Final = re.compile(r"random:(0|[1-9][0-9]{0,17})")
RASTER, ALL = "raster", "all"


@dataclass(frozen=True, kw_only=True)
class Reference:
    """One case's reference at the scoring raster.

    depth_z_m: (H, W) float32, +inf where there is no reference point; label: (H, W) int32 position
    in the scored objects, -1 elsewhere; sampled: whether the arrays were made at the raster's own
    centres, not taken from the full-size pixel that contains each of them.
    """

    raster: Raster
    depth_z_m: Depth
    label: Labels
    sampled: bool


@dataclass(frozen=True, kw_only=True)
class ReferenceCloud:
    """Reference points of another sampling, and the full-size labels that masks are read from.

    points_m: (N, 3); label: (N,); submitted_label: (H, W) of the raster: of the full-size pixel
    that contains each raster centre.
    """

    points_m: F64
    label: Labels
    submitted_label: Labels


def check_sampling(text: str) -> str:
    """raster, all or random:SEED. UsageError."""
    if text not in (RASTER, ALL) and not _RANDOM.fullmatch(text):
        raise UsageError(
            "there is no such sampling of the reference",
            found=repr(text),
            expected="raster, all or random:SEED",
        )
    return text


def load_reference(folders: BenchFolders, case: BenchCase, limit_m: float) -> Reference:
    """Read and check the private arrays. BenchTruthError when they are not those on record."""
    raster = picture_raster(case.size_wh, case.image.hfov_deg, case.truth.raster_wh)
    if case.truth.sha256.raster is not None:
        path = folders.arrays("raster", case)
        arrays = load_checked(path, case.truth.sha256.raster, ("depth_z_m", "instance"))
        depth, instance = arrays["depth_z_m"], arrays["instance"]
        _require(path, depth, (raster.height, raster.width))
        _require(path, instance, (raster.height, raster.width))
    else:
        whole, ids = _full_size(folders, case)
        rows, columns = containing_pixels(case.size_wh, raster)
        depth, instance = whole[np.ix_(rows, columns)], ids[np.ix_(rows, columns)]
    return Reference(
        raster=raster,
        depth_z_m=kept_depth(depth, limit_m),
        label=index_labels(instance, case.truth.scored),
        sampled=case.truth.sha256.raster is not None,
    )


def load_cloud(
    folders: BenchFolders, case: BenchCase, sampling: str, limit_m: float, cap: int
) -> ReferenceCloud:
    """Every full-size reference point, or `cap` of them drawn without replacement."""
    whole, ids = _full_size(folders, case)
    full = picture_raster(case.size_wh, case.image.hfov_deg, case.size_wh)
    depth, label = kept_depth(whole, limit_m), index_labels(ids, case.truth.scored)
    places = np.flatnonzero(finite_points(depth))
    drawn = _RANDOM.fullmatch(sampling)
    if drawn and len(places) > cap:
        random = np.random.default_rng(int(drawn[1]))
        places = np.sort(random.choice(places, cap, replace=False))
    raster = picture_raster(case.size_wh, case.image.hfov_deg, case.truth.raster_wh)
    rows, columns = containing_pixels(case.size_wh, raster)
    return ReferenceCloud(
        points_m=points_m(depth, full).reshape(-1, 3)[places],
        label=label.ravel()[places],
        submitted_label=np.ascontiguousarray(label[np.ix_(rows, columns)]),
    )


def containing_pixels(
    size_wh: tuple[int, int], raster: Raster
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row (H,) and column (W,) of the full-size pixel that contains each raster centre."""
    width, height = size_wh
    rows = np.floor((np.arange(raster.height) + 0.5) * height / raster.height)
    columns = np.floor((np.arange(raster.width) + 0.5) * width / raster.width)
    return rows.astype(np.intp), columns.astype(np.intp)


def kept_depth(depth_z_m: NDArray[Any], limit_m: float) -> Depth:
    """Float32 with +inf where a depth, of any shape, is no reference point."""
    depth = np.ascontiguousarray(depth_z_m, np.float32)
    return np.where(finite_points(depth, limit_m), depth, np.float32(np.inf))


def index_labels(instance: NDArray[Any], scored: Sequence[ScoredObject]) -> Labels:
    """Instance ids, any shape, as positions in a case's scored objects, -1 for every other one."""
    ids = np.array([one.id for one in scored], np.int64)
    order = np.argsort(ids)
    place = np.searchsorted(ids[order], instance)
    place = np.minimum(place, len(ids) - 1)
    known = ids[order][place] == instance
    return np.where(known, order[place], -1).astype(np.int32)


def _full_size(folders: BenchFolders, case: BenchCase) -> tuple[NDArray[Any], NDArray[Any]]:
    found = []
    for kind, name in (("depth", "depth_z_m"), ("instances", "instance")):
        path = folders.arrays(kind, case)
        array = load_checked(path, getattr(case.truth.sha256, kind), (name,))[name]
        width, height = case.size_wh
        _require(path, array, (height, width))
        found.append(array)
    return found[0], found[1]


def load_checked(path: Path, sha256: str, names: tuple[str, ...] | None) -> dict[str, NDArray[Any]]:
    """Arrays of an .npz whose hash is on record, in their shapes, None for all. BenchTruthError."""
    try:
        digest = sha256_of_file(path)
        if digest == sha256:
            stored = npz_arrays(path, path.name, names)
            return {name: stored[name] for name in names or stored}
    except (OSError, KeyError, DepthFileError) as error:
        raise BenchTruthError(
            f"{path.name} of the private half cannot be read",
            found=f"{type(error).__name__}: {cause(error)}",
            expected=f"an .npz with {' and '.join(names or ())}",
        ) from error
    raise BenchTruthError(
        f"{path.parent.name}/{path.name} is not the one truth.json has on record",
        found=digest[:12],
        expected=sha256[:12],
        next_step="restore the private half",
    )


def _require(path: Path, array: NDArray[Any], shape: tuple[int, int]) -> None:
    if array.shape != shape:
        raise BenchTruthError(
            f"{path.parent.name}/{path.name} is of another size",
            found="x".join(map(str, array.shape[::-1])),
            expected="x".join(map(str, shape[::-1])),
        )
