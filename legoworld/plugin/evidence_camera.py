"""The photo's camera: from a provider, or from a known field of view and vanishing points."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.plugin.vanishing_points import UndeterminedError, manhattan_camera
from legoworld.records.base import RecordError, decode
from legoworld.records.plugin_evidence import CameraEvidence, PhotoEvidence, ProviderCamera, Rows

#: The plugin's cameras have square pixels and their principal point in the middle.
_MOST_SKEW: Final = 0.02
_ORTHONORMAL: Final = 1e-3


class CameraProblem(NamedTuple):
    """Why a camera cannot be used: what it says, and what it would have to say."""

    found: str
    expected: str


def camera_evidence(
    photo: NDArray[np.uint8], hfov_deg: float | None, provider_camera: ProviderCamera | None
) -> CameraEvidence:
    """The camera of a photo, (H, W, 3), as far as it is known; what is not known says why.

    provider_camera: without a `camera_problem`. A rotation that it lacks is estimated.
    """
    if provider_camera is None:
        return _estimate_camera(photo, hfov_deg, None if hfov_deg is None else "given")
    hfov = math.degrees(2 * math.atan(provider_camera.width / 2 / provider_camera.fx))
    if provider_camera.world_from_cam_rotation is None:
        return _estimate_camera(photo, hfov, provider_camera.source)
    return CameraEvidence(
        hfov_deg=hfov,
        hfov_source=provider_camera.source,
        world_from_cam_rotation=provider_camera.world_from_cam_rotation,
        rotation_source=provider_camera.source,
        unknown=None,
    )


def unusable_camera(camera: ProviderCamera, problem: CameraProblem) -> CameraEvidence:
    """What is known where a provider that was asked answers with a camera that cannot be used."""
    return CameraEvidence(
        hfov_deg=None,
        hfov_source=None,
        world_from_cam_rotation=None,
        rotation_source=None,
        unknown=f"the camera of {camera.source} cannot be used: {problem.found}, not"
        f" {problem.expected}",
    )


def _estimate_camera(
    photo: NDArray[np.uint8], hfov_deg: float | None, source: str | None
) -> CameraEvidence:
    import cv2

    rotation: Rows | None = None
    unknown: str | None = None
    if hfov_deg is None:
        unknown = "the field of view is not known"
    else:
        gray = np.asarray(cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY), np.uint8)
        try:
            a, b, c = manhattan_camera(gray, hfov_deg).world_from_cam.tolist()
            rotation = (tuple(a), tuple(b), tuple(c))
        except UndeterminedError as error:
            unknown = str(error)
    return CameraEvidence(
        hfov_deg=hfov_deg,
        hfov_source=source,
        world_from_cam_rotation=rotation,
        rotation_source="vanishing points" if rotation else None,
        unknown=unknown,
    )


def read_camera(path: Path, about: PhotoEvidence) -> ProviderCamera:
    """A provider's file. EvidenceInvalidError where it is of another photo, or cannot be used."""
    try:
        camera = decode(ProviderCamera, path.read_bytes())
    except RecordError as error:
        raise _refused_error(
            path, CameraProblem(str(error), "a camera of schema plugin-camera")
        ) from (error)
    if problem := camera_problem(camera, about):
        raise _refused_error(path, problem)
    return camera


def camera_problem(camera: ProviderCamera, about: PhotoEvidence) -> CameraProblem | None:
    """Why the plugin cannot use a camera; None where it can."""
    if camera.photo_sha256 != about.sha256:
        return CameraProblem(f"photo_sha256 {camera.photo_sha256[:12]}...", "this photo's hash")
    if abs(camera.width * about.height - camera.height * about.width) > max(
        camera.width, camera.height, about.width, about.height
    ):
        return CameraProblem(
            f"{camera.width}x{camera.height}", f"the shape of {about.width}x{about.height}"
        )
    off = max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
    if abs(camera.fx / camera.fy - 1) > _MOST_SKEW or off > _MOST_SKEW:
        return CameraProblem(
            f"fx / fy {camera.fx / camera.fy:.3f}, principal point {off:.3f} off the middle",
            "square pixels and the principal point in the middle, within 2 %",
        )
    rotation = np.array(camera.world_from_cam_rotation or np.eye(3), np.float64)
    away = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if away > _ORTHONORMAL or np.linalg.det(rotation) < 0:
        return CameraProblem("world_from_cam_rotation", "a rotation")
    return None


def _refused_error(path: Path, problem: CameraProblem) -> EvidenceInvalidError:
    return EvidenceInvalidError(
        f"the camera of {path.name} cannot be used", found=problem.found, expected=problem.expected
    )
