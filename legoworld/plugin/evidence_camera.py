"""The photo's camera: from a provider, or from a known field of view and vanishing points."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.plugin.vanishing import UntoldError, manhattan_camera
from legoworld.records.base import RecordError, decode
from legoworld.records.plugin_evidence import CameraEvidence, PhotoEvidence, ProviderCamera, Rows

#: The plugin's cameras have square pixels and their principal point in the middle.
_MOST_SKEW: Final = 0.02
_ORTHONORMAL: Final = 1e-3


def camera_evidence(
    photo: NDArray[np.uint8], about: PhotoEvidence, hfov_deg: float | None, provided: Path | None
) -> CameraEvidence:
    """The camera as far as it is known; what is not known says why.

    provided: a provider's file; EvidenceInvalidError where it is of another photo, or describes a
    camera that the plugin cannot use. A rotation that it lacks is estimated.
    """
    if provided is None:
        return _estimated(photo, hfov_deg, None if hfov_deg is None else "given")
    camera = _read(provided, about)
    hfov = math.degrees(2 * math.atan(camera.width / 2 / camera.fx))
    if camera.world_from_cam_rotation is None:
        return _estimated(photo, hfov, camera.source)
    return CameraEvidence(
        hfov_deg=hfov,
        hfov_source=camera.source,
        world_from_cam_rotation=camera.world_from_cam_rotation,
        rotation_source=camera.source,
        unknown=None,
    )


def _estimated(
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
        except UntoldError as error:
            unknown = str(error)
    return CameraEvidence(
        hfov_deg=hfov_deg,
        hfov_source=source,
        world_from_cam_rotation=rotation,
        rotation_source="vanishing points" if rotation else None,
        unknown=unknown,
    )


def _read(path: Path, about: PhotoEvidence) -> ProviderCamera:
    try:
        camera = decode(ProviderCamera, path.read_bytes())
    except RecordError as error:
        raise _refused(path, str(error), "a camera of schema plugin-camera") from error
    if camera.photo_sha256 != about.sha256:
        raise _refused(path, f"photo_sha256 {camera.photo_sha256[:12]}...", "this photo's hash")
    if abs(camera.width * about.height - camera.height * about.width) > max(
        camera.width, camera.height, about.width, about.height
    ):
        raise _refused(
            path, f"{camera.width}x{camera.height}", f"the shape of {about.width}x{about.height}"
        )
    off = max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
    if abs(camera.fx / camera.fy - 1) > _MOST_SKEW or off > _MOST_SKEW:
        raise _refused(
            path, f"fx / fy {camera.fx / camera.fy:.3f}, principal point {off:.3f} off the middle",
            "square pixels and the principal point in the middle, within 2 %",
        )  # fmt: skip
    rotation = np.array(camera.world_from_cam_rotation or np.eye(3), np.float64)
    away = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if away > _ORTHONORMAL or np.linalg.det(rotation) < 0:
        raise _refused(path, "world_from_cam_rotation", "a rotation")
    return camera


def _refused(path: Path, found: str, expected: str) -> EvidenceInvalidError:
    return EvidenceInvalidError(
        f"the camera of {path.name} cannot be used", found=found, expected=expected
    )
