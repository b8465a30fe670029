"""One case of a bench as it is drawn: which points are hit, missed, extra or outside, and A."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError, cause
from legoworld.evaluation.reconstruction.appearance import PictureError, agreement
from legoworld.evaluation.reconstruction.fscore import match_surfaces
from legoworld.evaluation.reconstruction.geometry import r_moved
from legoworld.evaluation.reconstruction.nearest import share_raster
from legoworld.evaluation.reconstruction.picture_cache import resized_reference
from legoworld.evaluation.reconstruction.points import Depth, finite_points
from legoworld.evaluation.reconstruction.protocol import BenchProtocol
from legoworld.evaluation.reconstruction.reference import RASTER, Reference
from legoworld.evaluation.reconstruction.submission import load_render, load_surface
from legoworld.records.base import UNSET
from legoworld.records.reconstruction import ReconstructionRow
from legoworld.records.run_rows import RunRow
from legoworld.report.reconstruction_inputs import BenchInputs

#: Places in OUTCOMES of report/reconstruction_pictures.py.
NOTHING, HIT, MISSED, EXTRA, BOTH, OUTSIDE = range(6)

Codes = NDArray[np.uint8]
#: What a picture of other numbers than the score's is refused with.
_OTHER: Final = "its points do not add up to the score's: evaluate again"


class NoPictureError(LegoWorldError):
    """A submission has no picture; the text says why."""

    code = "no_picture"


@dataclass(frozen=True, kw_only=True)
class SeenSurface:
    """A submission's surface against its reference, at the scoring raster.

    reference_outcome: (H, W) HIT or MISSED in scored masks, OUTSIDE where a reference point is in
    none; submitted_outcome: HIT or EXTRA, OUTSIDE likewise; NOTHING without a point.
    """

    depth_z_m: Depth
    reference_outcome: Codes
    submitted_outcome: Codes

    @property
    def together(self) -> Codes:
        """Of each pixel; BOTH where its reference point is missed and its submitted one extra."""
        missed = self.reference_outcome == MISSED
        extra = self.submitted_outcome == EXTRA
        scored = np.isin(self.reference_outcome, (HIT, MISSED)) | np.isin(
            self.submitted_outcome, (HIT, EXTRA)
        )
        found = np.where(self.submitted_outcome == OUTSIDE, OUTSIDE, NOTHING)
        found = np.where(scored, HIT, found)
        found = np.where(missed, MISSED, np.where(extra, EXTRA, found))
        return np.where(missed & extra, BOTH, found).astype(np.uint8)


def seen_surface(
    inputs: BenchInputs,
    reference: Reference,
    run_row: RunRow,
    row: ReconstructionRow,
    protocol: BenchProtocol,
    sampling: str,
) -> SeenSurface:
    """A submission's points, found as R finds them. NoPictureError where there is no surface.

    Where R was computed on the raster the counts are held to the row's, object by object.
    """
    if run_row.surface is UNSET:
        raise NoPictureError("the run made no surface of it")
    depth = load_surface(inputs.run, run_row.surface, reference.raster).depth_z_m
    label = reference.label
    surfaces = share_raster(reference.depth_z_m, depth, label, reference.raster)
    pairs = match_surfaces(*surfaces)
    tolerance = protocol.headline
    hit = pairs.reference_distance_m <= tolerance.tau_m(pairs.reference_z_m)
    matched = pairs.submitted_distance_m <= tolerance.tau_m(pairs.nearest_z_m)
    g, q = finite_points(reference.depth_z_m), finite_points(depth)
    reference_outcome = np.where(g, OUTSIDE, NOTHING).astype(np.uint8)
    submitted_outcome = np.where(q, OUTSIDE, NOTHING).astype(np.uint8)
    reference_outcome[g & (label >= 0)] = np.where(hit, HIT, MISSED)
    submitted_outcome[q & (label >= 0)] = np.where(matched, HIT, EXTRA)
    if sampling == RASTER:
        for k, scored in enumerate(row.objects):
            mine = label == k
            if round(scored.recall * scored.n_reference) != np.count_nonzero(
                mine & (reference_outcome == HIT)
            ) or round(scored.precision * scored.n_submitted) != np.count_nonzero(
                mine & (submitted_outcome == HIT)
            ):
                raise NoPictureError(_OTHER)
    return SeenSurface(
        depth_z_m=depth, reference_outcome=reference_outcome, submitted_outcome=submitted_outcome
    )


def seen_from_reference(
    inputs: BenchInputs,
    reference: Reference,
    run_row: RunRow,
    surface: SeenSurface,
    protocol: BenchProtocol,
) -> float | None:
    """R of a submission's points as the reference's camera sees them in the submission's world."""
    if run_row.camera is UNSET:
        return None
    truth = inputs.dataset.cases[run_row.image_id].truth
    cameras = (run_row.camera, truth.camera)
    ours, theirs = (np.array(camera.world_from_cam, np.float64) for camera in cameras)
    motion = np.linalg.solve(theirs, ours)
    return r_moved(reference, surface.depth_z_m, motion, protocol, len(truth.scored))


def differences(inputs: BenchInputs, run_row: RunRow, row: ReconstructionRow) -> Codes:
    """(h, w) largest channel difference of each pixel of A. NoPictureError without a render."""
    if run_row.render is UNSET:
        raise NoPictureError("the run made no render of it")
    case = inputs.dataset.cases[row.image_id]
    render = load_render(inputs.run, run_row.render)
    try:
        data = inputs.dataset.folders.reference(case).read_bytes()
        picture = resized_reference(data, case.truth.sha256.reference, run_row.render.size_wh)
    except (OSError, PictureError) as error:
        raise NoPictureError(f"the reference picture cannot be read: {cause(error)}") from error
    largest: Codes = agreement(render, picture).largest
    if row.appearance is not None and row.appearance.n_px != largest.size:
        raise NoPictureError(_OTHER)
    return largest
