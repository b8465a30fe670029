"""COLMAP's camera models of ETH3D's photos: from a distorted pixel to the pinhole's pixel."""

from __future__ import annotations

from typing import Final

import numpy as np

from legoworld.evaluation.depth.errors import CameraModelError
from legoworld.evaluation.pixels.family import F64
from legoworld.pluralize import plural
from legoworld.tracks.colmap import Camera

#: Number of parameters by model, in the order of cameras.txt.
#: PINHOLE: fx fy cx cy; THIN_PRISM_FISHEYE: fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1.
PARAMETERS: Final = {"PINHOLE": 4, "THIN_PRISM_FISHEYE": 12}

_MAX_STEPS: Final = 50
#: In normalised image coordinates: 1e-12 is some 4e-9 pixels of a 6048 px wide photo.
_CONVERGED: Final = 1e-12


def pinhole_from_distorted(camera: Camera, distorted_xy_px: F64) -> F64:
    """Map distorted pixels to those of the pinhole camera with the same fx, fy, cx, cy.

    distorted_xy_px and the result: (n, 2), x and y from the top left corner of the image.
    CameraModelError if the model is unknown or a pixel has no ray in front of the camera.
    """
    if camera.model not in PARAMETERS or len(camera.params) != PARAMETERS[camera.model]:
        raise CameraModelError(
            "unknown camera model",
            found=f"{camera.model} with {len(camera.params)} parameters",
            expected=", ".join(f"{name} with {n}" for name, n in PARAMETERS.items()),
            next_step="score with --camera-model none",
        )
    if camera.model == "PINHOLE":
        return distorted_xy_px
    focal = np.array(camera.params[:2])
    centre = np.array(camera.params[2:4])
    angles = _undistort((distorted_xy_px - centre) / focal, camera.params[4:])
    theta = np.hypot(angles[:, 0], angles[:, 1])
    if len(theta) and theta.max() >= np.pi / 2:
        raise _no_ray(int(np.count_nonzero(theta >= np.pi / 2)), "90 degrees or more off axis")
    # Equidistant fisheye to pinhole: the radius theta becomes tan(theta).
    stretch = np.ones_like(theta)
    np.divide(np.tan(theta), theta, out=stretch, where=theta > 1e-9)
    pinhole_xy_px: F64 = angles * stretch[:, None] * focal + centre
    return pinhole_xy_px


def _undistort(distorted_uv: F64, coefficients: tuple[float, ...]) -> F64:
    """Solve uv + distortion(uv) = distorted_uv for (n, 2) uv by Newton's method."""
    uv = distorted_uv.copy()
    for _ in range(_MAX_STEPS):
        value, jacobian = _distort(uv, coefficients)
        f_u, f_v, g_u, g_v = jacobian
        error = value - distorted_uv
        determinant = f_u * g_v - f_v * g_u
        if np.any(determinant <= 0):
            raise _no_ray(int(np.count_nonzero(determinant <= 0)), "the distortion folds over")
        step_u = (g_v * error[:, 0] - f_v * error[:, 1]) / determinant
        step_v = (f_u * error[:, 1] - g_u * error[:, 0]) / determinant
        uv = uv - np.stack([step_u, step_v], axis=1)
        finished = np.maximum(np.abs(step_u), np.abs(step_v)) < _CONVERGED
        if finished.all():
            return uv
    raise _no_ray(len(uv), f"not all converge in {_MAX_STEPS} steps")


def _distort(uv: F64, coefficients: tuple[float, ...]) -> tuple[F64, tuple[F64, F64, F64, F64]]:
    """COLMAP's thin prism distortion of (n, 2) uv, and its four partial derivatives.

    With r2 = u^2 + v^2 and R = k1 r2 + k2 r2^2 + k3 r2^3 + k4 r2^4:
    f = u + u R + 2 p1 u v + p2 (r2 + 2 u^2) + sx1 r2, g = v + v R + 2 p2 u v + p1 (r2 + 2 v^2)
    + sy1 r2 (COLMAP, sensor/models.h, ThinPrismFisheyeCameraModel).
    """
    k1, k2, p1, p2, k3, k4, sx1, sy1 = coefficients
    u, v = uv[:, 0], uv[:, 1]
    uu, uv_product, vv = u * u, u * v, v * v
    r2 = uu + vv
    radial = r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    slope = k1 + r2 * (2 * k2 + r2 * (3 * k3 + r2 * 4 * k4))  # of radial, by r2
    f = u + u * radial + 2 * p1 * uv_product + p2 * (r2 + 2 * uu) + sx1 * r2
    g = v + v * radial + 2 * p2 * uv_product + p1 * (r2 + 2 * vv) + sy1 * r2
    f_u = 1 + radial + 2 * uu * slope + 2 * p1 * v + 6 * p2 * u + 2 * sx1 * u
    f_v = 2 * uv_product * slope + 2 * p1 * u + 2 * p2 * v + 2 * sx1 * v
    g_u = 2 * uv_product * slope + 2 * p2 * v + 2 * p1 * u + 2 * sy1 * u
    g_v = 1 + radial + 2 * vv * slope + 2 * p2 * u + 6 * p1 * v + 2 * sy1 * v
    return np.stack([f, g], axis=1), (f_u, f_v, g_u, g_v)


def _no_ray(count: int, why: str) -> CameraModelError:
    return CameraModelError(
        "the camera model has no ray for a pixel",
        found=f"{why} ({plural(count, 'pixel', 'pixels')})",
        expected="a distortion that is invertible over the whole image",
        next_step="check the parameters in cameras.txt, or score with --camera-model none",
    )
