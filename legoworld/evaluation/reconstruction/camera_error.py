"""The submission's camera against the reference's: none of it enters a score."""

from __future__ import annotations

import numpy as np

from legoworld.evaluation.reconstruction.aligned import angle_rad
from legoworld.evaluation.reconstruction.dataset import BenchCase
from legoworld.records.base import UNSET
from legoworld.records.reconstruction import CameraError, Registration
from legoworld.records.submission import BenchRow


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
