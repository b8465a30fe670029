"""One case of a reference scene: what its camera sees, what is scored, and the noise floor of A."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import SceneInvalidError
from legoworld.evaluation.reconstruction.appearance import agreement, decode_picture, resize_picture
from legoworld.readouts.joints import part_surfaces
from legoworld.records.base import as_json, to_record
from legoworld.records.bench_dataset import NoiseFloor, ReferenceJoint, ScoredObject
from legoworld.records.joints import SceneJoint
from legoworld.scene.instances import Grouping
from legoworld.scene.snapshot import SceneCamera, Snapshot
from legoworld.tracks.vocabulary import normal_name
from legoworld.visibility.camera import projection
from legoworld.visibility.projection import Projection
from legoworld.visibility.scoring_raster import on_raster, picture_projection, raster_size
from legoworld.visibility.view import view_through

#: A principal point further from the middle than this, in pixels, is a shifted lens.
_CENTRED_PX: Final = 1e-6


class CaseRefusedError(SceneInvalidError):
    """A reference scene cannot become a case."""

    code = "case_refused"


@dataclass(frozen=True, kw_only=True)
class SeenCase:
    """A case's buffers: (H, W) at the picture's size, and at the scoring raster.

    depth_z_m: float32, +inf where nothing is hit; instance: int32, -1 there.
    """

    projection: Projection
    hfov_deg: float
    raster_wh: tuple[int, int]
    depth_z_m: NDArray[np.float32]
    instance: NDArray[np.int32]
    raster_depth_z_m: NDArray[np.float32]
    raster_instance: NDArray[np.int32]
    scored_objects: tuple[ScoredObject, ...]


def reference_joints(
    snapshot: Snapshot,
    grouping: Grouping,
    scored_objects: Sequence[ScoredObject],
    joints: Sequence[SceneJoint],
) -> tuple[ReferenceJoint, ...]:
    """The joints whose part has geometry in this case, with the scored object it belongs to.

    A part of several instances belongs to that of its first surface.
    """
    ids = {one.id for one in scored_objects}
    references = []
    for joint in joints:
        surfaces = part_surfaces(snapshot, joint.part)
        if not len(surfaces) or joint.box_cam_m is None:
            continue
        owner = int(grouping.surface_instance[surfaces[0]])
        references.append(
            to_record(
                ReferenceJoint,
                {**as_json(joint), "object_id": owner if owner in ids else None},
            )
        )
    return tuple(references)


def see_case(
    snapshot: Snapshot,
    grouping: Grouping,
    size_wh: tuple[int, int],
    unscored: frozenset[str],
    *,
    threads: int,
) -> SeenCase:
    """Render a reference at full size and at the raster, through the pinhole the public half tells.

    unscored: names of owners that are not scored. Raises CaseRefusedError.
    """
    hfov_deg = public_hfov_deg(snapshot, size_wh)
    camera = snapshot.camera
    pinhole = picture_projection(
        size_wh, hfov_deg, z_near=camera.clip_start, z_far=camera.clip_end
    )  # fmt: skip
    raster_wh = raster_size(size_wh)
    raster = on_raster(pinhole, size_wh, raster_wh)
    small = view_through(raster, snapshot, grouping, raster_wh, threads=threads)
    if not np.isfinite(small.buffers.depth_z_m).any():
        raise CaseRefusedError(
            "the reference camera sees nothing",
            found=f"no geometry at any of {raster_wh[0]}x{raster_wh[1]} points",
            expected="a view of the scene",
            next_step="turn the camera, or correct its clip range",
        )
    scored = _scored_objects(grouping, small.area_px, unscored)
    full = view_through(pinhole, snapshot, grouping, size_wh, threads=threads)
    return SeenCase(
        projection=pinhole,
        hfov_deg=hfov_deg,
        raster_wh=raster_wh,
        depth_z_m=full.buffers.depth_z_m,
        instance=full.buffers.instance,
        raster_depth_z_m=small.buffers.depth_z_m,
        raster_instance=small.buffers.instance,
        scored_objects=scored,
    )


def public_hfov_deg(snapshot: Snapshot, size_wh: tuple[int, int]) -> float:
    """The horizontal field of view, where it says all of a camera's intrinsics.

    Raises CaseRefusedError for any other camera: an agent could not know it.
    """
    camera = snapshot.camera
    own = projection(camera, snapshot.render, size_wh)
    problem = _not_a_plain_pinhole(camera, own, size_wh)
    if problem:
        raise CaseRefusedError(
            "the reference camera is not fully described by its field of view",
            found=f"camera {camera.name!r}: {problem}",
            expected="a perspective camera, square pixels, no lens shift",
            next_step="correct the camera's settings and save the scene",
        )
    return math.degrees(2 * math.atan(size_wh[0] / 2 / own.fx))


def _not_a_plain_pinhole(
    camera: SceneCamera, own: Projection, size_wh: tuple[int, int]
) -> str | None:
    if camera.type != "PERSP":
        return "it is orthographic"
    if not math.isclose(own.fx, own.fy, rel_tol=1e-9):
        return "its pixels are not square"
    middle = (size_wh[0] / 2, size_wh[1] / 2)
    if max(abs(own.cx - middle[0]), abs(own.cy - middle[1])) > _CENTRED_PX:
        return f"its lens is shifted by {camera.shift_x:g}, {camera.shift_y:g}"
    return None


def _scored_objects(
    grouping: Grouping, area_px: NDArray[np.int64], unscored: frozenset[str]
) -> tuple[ScoredObject, ...]:
    labelled = [i for i in grouping.instances if i.category is not None and i.label_text]
    eligible = tuple(
        ScoredObject(id=i.id, name=i.name, category=normal_name(i.label_text or ""))
        for i in labelled
        if area_px[i.id] > 0 and i.name not in unscored
    )
    if not eligible:
        raise CaseRefusedError(
            "the reference has no eligible object",
            found=f"{len(labelled)} labelled instances, none visible and scored",
            expected="a visible instance with the custom property `category`",
            next_step="label what is to be scored, or turn the camera to it",
        )
    return eligible


def noise_floor(
    seeds: tuple[int, ...], renders: Sequence[bytes], picture: bytes, delta: int
) -> NoiseFloor:
    """A of each render against the reference picture, and their standard deviation (ddof = 1).

    renders: one PNG a seed; sd is 0 for a single seed, which says nothing of noise.
    """
    reference = decode_picture(picture)
    shares = []
    for png in renders:
        render = decode_picture(png)
        size_wh = (render.shape[1], render.shape[0])
        shares.append(agreement(render, resize_picture(reference, size_wh)).share(delta))
    sd = statistics.stdev(shares) if len(shares) > 1 else 0.0
    return NoiseFloor(seeds=seeds, a_self=tuple(shares), sd=sd)
