"""LEGO-Bench-X of one case: what a submission is beyond the one picture that was given."""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.kernels.library import call
from legoworld.evaluation.reconstruction import appearance
from legoworld.evaluation.reconstruction.dataset import (
    BenchCase,
    BenchFolders,
    BenchTruthError,
    read_record,
)
from legoworld.evaluation.reconstruction.fscore import Score, mean_f1, scores_on_rasters
from legoworld.evaluation.reconstruction.integrity import make_flag
from legoworld.evaluation.reconstruction.nearest import share_raster
from legoworld.evaluation.reconstruction.picture_cache import resized_reference
from legoworld.evaluation.reconstruction.points import (
    Depth,
    Flags,
    Raster,
    picture_raster,
    point_pixels,
    points_m,
)
from legoworld.evaluation.reconstruction.protocol import BenchProtocol, XRules
from legoworld.evaluation.reconstruction.reference import (
    Reference,
    index_labels,
    kept_depth,
    load_checked,
)
from legoworld.evaluation.reconstruction.submission import load_arrays, load_render
from legoworld.files import sha256_of_file
from legoworld.readouts.probing import OFFSET, VIEW
from legoworld.records.reconstruction import Flag, FlagKind
from legoworld.records.second_card import CONTEXT, OWN, BenchXFile, BenchXImage, Object3D, XScores
from legoworld.records.submission import ProbedFile
from legoworld.records.track import SecondView

#: The second card's track and truth, in DATASET/private.
X: Final = "x.json"
#: An object counts in F3D where so many of its samples, and such a share, are its own alone.
FEWEST_OWN: Final = 32
LEAST_OWN: Final = 0.1
#: Share of the second view's pixels whose surface the first one shows that A_x_seen needs.
LEAST_SEEN: Final = 0.1


@dataclass(frozen=True, kw_only=True)
class SecondCard:
    """x.json, read. images: by image id."""

    sha256: str
    images: dict[int, BenchXImage]


def read_second_card(folders: BenchFolders, track_sha256: str) -> SecondCard:
    """BenchTruthError where it is not there, or of another public half."""
    path = folders.private / X
    file = read_record(BenchXFile, path, "DATASET/private as `bench make` writes it")
    if file.info.track_sha256 != track_sha256:
        raise BenchTruthError(
            f"private/{X} is of another dataset",
            found=f"track {file.info.track_sha256[:12]}",
            expected=f"track {track_sha256[:12]}",
            next_step="make the dataset again",
        )
    return SecondCard(
        sha256=sha256_of_file(path), images={image.id: image for image in file.images}
    )


def zero_scores(image: BenchXImage) -> XScores:
    """Of a submission that is not valid."""
    return XScores(
        R_p=0.0,
        R_x=None if image.probe.view is None else 0.0,
        A_x=None if image.probe.view is None else 0.0,
        F3D=0.0,
        found=0.0,
        R_empty=image.x.R_empty,
        R_above_empty=above_empty(0.0, image.x.R_empty),
        objects=(),
        A_x_seen=None,
        surface_differs=None,
        unreadable_alpha=0,
    )


def above_empty(r: float, empty: float) -> float | None:
    """R on a scale where 0 is the reference without its objects and 1 the reference."""
    return (r - empty) / (1.0 - empty) if empty < 1.0 else None


def second_scores(
    run: Path,
    file: ProbedFile,
    folders: BenchFolders,
    case: BenchCase,
    image: BenchXImage,
    reference: Reference,
    protocol: BenchProtocol,
    r: float,
) -> XScores:
    """The card of a valid submission. SubmissionFileError, BenchTruthError."""
    assert protocol.x is not None
    theirs = load_arrays(run, file)
    path = folders.arrays("x", case)
    ours = load_checked(path, image.x.arrays_sha256, None)
    raster = picture_raster(case.size_wh, case.image.hfov_deg, case.truth.raster_wh)
    dx, dy = image.probe.offset_px
    moved = replace(raster, cx=raster.cx - dx, cy=raster.cy - dy)
    r_x, a_x, a_x_seen, view = None, None, None, image.probe.view
    if view is not None:
        second = picture_raster(case.size_wh, view.hfov_deg, case.truth.raster_wh)
        r_x = _r(VIEW, second, ours, theirs, case, protocol)
        hits = _hits(run, file, folders, image, protocol.delta)
        if hits is not None:
            a_x = float(np.count_nonzero(hits)) / hits.size
            depth = kept_depth(ours[f"{VIEW}_depth_z_m"], protocol.depth_limit_m)
            known = shown_first(depth, second, view, reference, protocol.x.same_surface)
            known = known[appearance.raster_indices(hits.shape, known.shape)]
            if known.mean() >= LEAST_SEEN:
                a_x_seen = float(hits[known].mean())
    objects = tuple(_objects(ours, theirs, image, case, protocol.x))
    eligible = [o for o in objects if o.eligible]
    return XScores(
        R_p=_r(OFFSET, moved, ours, theirs, case, protocol),
        R_x=r_x,
        A_x=a_x,
        F3D=float(np.mean([o.f1 for o in eligible])) if eligible else None,
        found=float(np.mean([o.found for o in eligible])) if eligible else None,
        R_empty=image.x.R_empty,
        R_above_empty=above_empty(r, image.x.R_empty),
        objects=objects,
        A_x_seen=a_x_seen,
        surface_differs=file.surface_differs,
        unreadable_alpha=file.unreadable_alpha,
    )


def _r(
    name: str,
    raster: Raster,
    ours: Mapping[str, NDArray[Any]],
    theirs: Mapping[str, NDArray[Any]],
    case: BenchCase,
    protocol: BenchProtocol,
) -> float:
    """R's own card through another grid."""
    label = index_labels(ours[f"{name}_instance"], case.truth.scored)
    ours_z_m = kept_depth(ours[f"{name}_depth_z_m"], protocol.depth_limit_m)
    surfaces = share_raster(ours_z_m, theirs[f"{name}_depth_z_m"], label, raster)
    (scores,) = scores_on_rasters(*surfaces, len(case.truth.scored), (protocol.headline,))
    return mean_f1(scores) or 0.0


def shown_first(
    depth_z_m: Depth, raster: Raster, view: SecondView, reference: Reference, relative: float
) -> Flags:
    """(H, W) the second view's pixels whose surface the first view shows.

    One of the 3 x 3 pixels around the place where the first view has the point is at its depth,
    give or take `relative`: silhouettes do not fall on samples.
    """
    motion = np.array(view.cam_from_view)
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(reference.depth_z_m, 1, mode="edge"), (3, 3)
    ).reshape(-1, 9)
    with np.errstate(invalid="ignore"):  # nothing is hit at infinity
        points = points_m(depth_z_m, raster).reshape(-1, 3) @ motion[:3, :3].T + motion[:3, 3]
        pixel, z = point_pixels(points, reference.raster), points[:, 2:]
        near = (np.abs(around[pixel] - z) <= relative * z).any(axis=1)
    seen: Flags = near & (pixel >= 0)
    return seen.reshape(depth_z_m.shape)


def _hits(
    run: Path, file: ProbedFile, folders: BenchFolders, image: BenchXImage, delta: int
) -> Flags | None:
    """The pixels that A's own card counts in the second view."""
    if file.render is None or image.x.picture is None or image.x.picture_sha256 is None:
        return None
    path = folders.private.parent / image.x.picture
    data = path.read_bytes() if path.is_file() else b""
    digest = hashlib.sha256(data).hexdigest()
    if digest != image.x.picture_sha256:
        raise BenchTruthError(
            f"the picture {image.x.picture} is not the one private/{X} has on record",
            found=digest[:12],
            expected=image.x.picture_sha256[:12],
            next_step="restore the dataset",
        )
    picture = resized_reference(data, digest, file.render.size_wh)
    return appearance.agreement(load_render(run, file.render), picture).hits(delta)


def _objects(
    ours: Mapping[str, NDArray[Any]],
    theirs: Mapping[str, NDArray[Any]],
    image: BenchXImage,
    case: BenchCase,
    rules: XRules,
) -> Iterator[Object3D]:
    """F3D of each object: recall of its own surface, precision of what is submitted in its box.

    What lies within tau of anything else that the reference has there is neither right nor wrong:
    a floor is no part of what stands on it, and no mistake.
    """
    for k, scored in enumerate(case.truth.scored):
        tau = image.probe.spacings_m[k] / rules.spacing
        here = ours["point_object"] == k
        reference, kind = ours["points_m"][here], ours["point_kind"][here]
        own, context = reference[kind == OWN], reference[kind == CONTEXT]
        submitted = theirs["points_m"][theirs["point_object"] == k]
        counted = submitted[~within(submitted, context, tau)]
        score = Score(
            n_reference=len(own),
            n_submitted=len(counted),
            reference_hits=int(np.count_nonzero(within(own, submitted, tau))),
            submitted_hits=int(np.count_nonzero(within(counted, reference[kind != CONTEXT], tau))),
        )
        of_object = int(np.count_nonzero(kind != CONTEXT))
        eligible = len(own) >= max(FEWEST_OWN, LEAST_OWN * of_object)
        yield Object3D(
            id=scored.id,
            eligible=eligible,
            f1=score.f1,
            precision=score.precision,
            recall=score.recall,
            found=score.f1 >= rules.found,
        )


def within(
    points_m: NDArray[np.float32], targets_m: NDArray[np.float32], tau_m: float
) -> NDArray[np.bool_]:
    """(N,) whether a point has a target within tau."""
    near = np.zeros(len(points_m), np.uint8)
    if len(points_m) and len(targets_m):
        points, targets = (np.ascontiguousarray(c, np.float32) for c in (points_m, targets_m))
        tau = ctypes.c_double(tau_m)
        call("lw_within", points, len(points), targets, len(targets), tau, near)
    return near.view(bool)


def second_flags(scores: XScores, r: float, a: float | None, rules: XRules) -> Iterator[Flag]:
    """What one look does not see that the headline was scored by."""
    drops: tuple[tuple[FlagKind, str, float, float], ...] = (
        ("sub_pixel_surface", f"R_p {scores.R_p:.3f}", r - scores.R_p, rules.sub_pixel_drop),
        (
            "one_view_geometry",
            f"R_x {scores.R_x or 0.0:.3f}",
            0.0 if scores.R_x is None else r - scores.R_x,
            rules.geometry_drop,
        ),
        (
            "one_view_appearance",
            f"A_x {scores.A_x_seen or 0.0:.3f} of what the first picture shows",
            0.0 if a is None or scores.A_x_seen is None else a - scores.A_x_seen,
            rules.one_view_drop,
        ),
        (
            "surface_not_in_picture",
            f"{scores.unreadable_alpha} materials with alpha taken as opaque",
            scores.surface_differs or 0.0,
            rules.surface_differs,
        ),
    )
    for kind, what, measured, threshold in drops:
        if measured >= threshold:
            yield make_flag(kind, what, measured, threshold)
