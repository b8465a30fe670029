"""One case: a submission's surface, render and camera against the reference, as a row."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from msgspec.structs import replace

from legoworld.errors import cause
from legoworld.evaluation.reconstruction import appearance, integrity
from legoworld.evaluation.reconstruction.aligned import angle_rad
from legoworld.evaluation.reconstruction.appearance import Agreement, Picture
from legoworld.evaluation.reconstruction.dataset import (
    BenchCase,
    BenchFolders,
    BenchTruthError,
    SubmissionFileError,
)
from legoworld.evaluation.reconstruction.geometry import PointMaps, geometry_score
from legoworld.evaluation.reconstruction.joints import not_valid, score_articulation
from legoworld.evaluation.reconstruction.picture_cache import resized_reference
from legoworld.evaluation.reconstruction.points import Flags, finite_points, hit_share
from legoworld.evaluation.reconstruction.protocol import BenchProtocol, Choices
from legoworld.evaluation.reconstruction.reference import Reference, load_reference
from legoworld.evaluation.reconstruction.second_card import (
    second_flags,
    second_scores,
    zero_scores,
)
from legoworld.evaluation.reconstruction.submission import Surface, load_render, load_surface
from legoworld.records.base import UNSET
from legoworld.records.reconstruction import (
    COMPARED,
    Appearance,
    CameraError,
    Flag,
    NoiseBeside,
    ReconstructionRow,
    Registration,
)
from legoworld.records.second_card import BenchXImage
from legoworld.records.submission import BenchRow, Check, RenderFile, Validity

#: Scripts never run and the render card has no compositor: alone, an artist's leftovers.
_IDLE: Final = ("text_blocks", "compositor_nodes")


def camera_error(
    row: BenchRow, case: BenchCase, registration: Registration | None
) -> CameraError | None:
    """Field of view and pose, submitted against reference; None where the run has no camera."""
    if row.camera is UNSET:
        return None
    submitted = row.camera
    ours = np.array(submitted.world_from_cam, np.float64)
    theirs = np.array(case.truth.camera.world_from_cam, np.float64)
    between = theirs[:3, :3].T @ ours[:3, :3]
    fov = submitted.hfov_deg
    return CameraError(
        fov_deg=None if fov is None else fov - case.image.hfov_deg,
        world_rotation_deg=float(np.degrees(angle_rad(between))),
        world_translation_m=float(np.linalg.norm(ours[:3, 3] - theirs[:3, 3])),
        registration=registration,
    )


@dataclass(frozen=True, kw_only=True)
class CaseTask:
    """One case to score. run: the run's folder; x: the second card's half, None without one."""

    run: Path
    row: BenchRow
    case: BenchCase
    folders: BenchFolders
    protocol: BenchProtocol
    choices: Choices
    x: BenchXImage | None = None


def score_case(task: CaseTask) -> ReconstructionRow:
    """The case's row. BenchTruthError for the private half; a run's bad file is a row of zeros."""
    row, zeros = task.row, zero_row(task)
    if row.status != COMPARED:
        return zeros
    reference = load_reference(task.folders, task.case, task.protocol.depth_limit_m)
    try:
        if row.surface is UNSET:
            raise SubmissionFileError(
                "the run made no surface", found="none", expected="surface/<name>.npz"
            )
        surface = load_surface(task.run, row.surface, reference.raster)
        render = None if row.render is UNSET else load_render(task.run, row.render)
        compared = _score_compared(task, zeros, reference, surface, render)
        return _with_second_card(task, compared, reference, surface)
    except SubmissionFileError as error:
        return replace(zeros, status="changed", code=error.code, reason=str(error))


def zero_row(task: CaseTask) -> ReconstructionRow:
    """The case with V = R = A = S = 0 and everything that is known without comparing."""
    row, image = task.row, task.case.image
    validity = None if row.validity is UNSET else row.validity
    return ReconstructionRow(
        image_id=row.image_id,
        file_name=row.file_name,
        status=row.status,
        code=row.code if row.status != COMPARED else None,
        reason=row.reason,
        run_status=row.status,
        warnings=row.warnings,
        family=image.family,
        environment=image.environment,
        theme=image.theme,
        split=image.split,
        tier=image.tier,
        view=image.view,
        valid=False,
        validity=_checks(validity) if validity else None,
        R=0.0,
        A=0.0,
        S=0.0,
        R_at={},
        objects=(),
        fov_error_deg=None,
        camera=None,
        diagnostics=None,
        appearance=None,
        flags=(),
        articulation=not_valid(task.case),
        x=UNSET if task.x is None else zero_scores(task.x),
    )


def _with_second_card(
    task: CaseTask, row: ReconstructionRow, reference: Reference, surface: Surface
) -> ReconstructionRow:
    """The row with the numbers and flags of bench-x, where that is the task."""
    if task.x is None or not row.valid or row.R is None:
        return row
    if task.row.probe is UNSET:
        raise SubmissionFileError(
            "the run made no probe", found="none", expected="probe/<name>.npz"
        )
    rules = task.protocol.x
    assert rules is not None
    scores = second_scores(
        task.run, task.row.probe, task.folders, task.case, task.x, reference, task.protocol, row.R
    )
    flags = [*row.flags, *second_flags(scores, row.R, row.A, rules)]
    if len(surface.textures) and task.row.integrity is not UNSET:
        height, width = surface.textures.shape[1:3]
        picture = _reference_picture(task, (width, height))
        facts = task.row.integrity
        flags += integrity.scale_flags(facts, surface.textures, picture, rules.scales)
    if all(flag.kind in _IDLE for flag in flags):
        flags = []  # they say nothing alone
    return replace(row, x=scores, flags=tuple(flags))


def _checks(validity: Validity) -> dict[str, Check]:
    return {name: getattr(validity, name) for name in validity.__struct_fields__}


def _score_compared(
    task: CaseTask,
    row: ReconstructionRow,
    reference: Reference,
    surface: Surface,
    render: Picture | None,
) -> ReconstructionRow:
    points = PointMaps(reference=reference, surface=surface)
    score = geometry_score(
        task.folders, task.case, reference, surface, points, task.protocol, task.choices
    )
    valid = bool(task.row.valid)
    picture = None
    seen: tuple[Agreement, Appearance] | None = None
    if render is not None and task.row.render is not UNSET:
        picture = _reference_picture(task, task.row.render.size_wh)
        seen = _appearance(task, task.row.render, render, picture, reference, surface, points)
    r = score.r if valid else 0.0
    a = None if seen is None else seen[1].n_hits / seen[1].n_px if valid else 0.0
    camera = camera_error(task.row, task.case, score.registration)
    return replace(
        row,
        valid=valid,
        R=r,
        A=a,
        S=None if a is None else (r + a) / 2,
        R_at=score.r_at,
        objects=score.objects,
        fov_error_deg=camera.fov_deg if camera else None,
        camera=camera,
        diagnostics=score.diagnostics,
        appearance=seen[1] if seen else None,
        flags=tuple(_flags(task, surface, picture, seen, score.r)),
        articulation=(
            score_articulation(
                task.case, task.row, reference, surface, task.protocol.headline.relative
            )
            if valid
            else row.articulation
        ),
    )


def _reference_picture(task: CaseTask, size_wh: tuple[int, int]) -> Picture:
    """The reference at a size. BenchTruthError where it is not the one on record."""
    path, recorded = task.folders.reference(task.case), task.case.truth.sha256.reference
    try:
        data = path.read_bytes()
        digest = hashlib.sha256(data).hexdigest()
        if digest == recorded:
            return resized_reference(data, recorded, size_wh)
        digest = digest[:12]
    except (OSError, appearance.PictureError) as error:
        digest = cause(error)
    raise BenchTruthError(
        f"the reference picture {path.name} is not the one truth.json has on record",
        found=digest,
        expected=recorded[:12],
        next_step="restore public/images",
    )


def _appearance(
    task: CaseTask,
    file: RenderFile,
    render: Picture,
    picture: Picture,
    reference: Reference,
    surface: Surface,
    points: PointMaps,
) -> tuple[Agreement, Appearance]:
    agreement = appearance.agreement(render, picture)
    hits = agreement.hits(task.protocol.delta)
    agrees = _same_ray(reference, surface, points, task.protocol.headline.relative)
    agrees = agrees[appearance.raster_indices(hits.shape, agrees.shape)]
    floor = task.case.truth.noise_floor
    return agreement, Appearance(
        n_px=hits.size,
        n_hits=int(np.count_nonzero(hits)),
        curve=appearance.curve(agreement, task.protocol.delta),
        where_geometry_agrees=hit_share(hits, agrees),
        n_geometry_agrees_px=int(np.count_nonzero(agrees)),
        where_geometry_differs=hit_share(hits, ~agrees),
        n_geometry_differs_px=int(np.count_nonzero(~agrees)),
        noise=NoiseBeside(
            reference_mean=float(np.mean(floor.a_self)) if floor and floor.a_self else None,
            reference_sd=floor.sd if floor else None,
            two_seeds=file.noise.share_over_delta if file.noise else None,
        ),
    )


def _same_ray(reference: Reference, surface: Surface, points: PointMaps, relative: float) -> Flags:
    """(H, W) where both points of a raster pixel are within tau, or neither is there."""
    g, q = finite_points(reference.depth_z_m), finite_points(surface.depth_z_m)
    with np.errstate(invalid="ignore", over="ignore"):
        apart = points.submitted_m - points.reference_m
        distance = np.sqrt(np.einsum("ijk,ijk->ij", apart, apart))
        near: Flags = distance <= relative * reference.depth_z_m.astype(np.float64)
    return np.where(g & q, near, g == q)


def _flags(
    task: CaseTask,
    surface: Surface,
    picture: Picture | None,
    seen: tuple[Agreement, Appearance] | None,
    r: float,
) -> list[Flag]:
    facts, thresholds = task.row.integrity, task.protocol.flags
    flags: list[Flag] = []
    if facts is not UNSET:
        if picture is None and len(surface.textures):
            height, width = surface.textures.shape[1:3]
            picture = _reference_picture(task, (width, height))
        flags += integrity.scene_flags(facts, surface.textures, picture, thresholds)
        if seen is not None and surface.plane is not None:
            hits = seen[0].hits(task.protocol.delta)
            rows = appearance.raster_indices(hits.shape, surface.plane.shape)
            flags += integrity.plane_flags(facts, surface.plane[rows], hits, thresholds)
    if seen is not None:
        flags += integrity.score_flags(r, seen[1].n_hits / seen[1].n_px, thresholds)
    return flags
