"""The thin prism fisheye: its own formula backwards, COLMAP's functions, the warp's direction."""

from __future__ import annotations

import numpy as np
import pytest
from evaluation.depth.folders import COURTYARD
from hypothesis import given, settings
from hypothesis import strategies as st

from legoworld.evaluation.depth.arrays import CameraModelError, DepthArray
from legoworld.evaluation.depth.rows import camera_warp, pinhole_from_distorted
from legoworld.evaluation.pixels.resampling import sampler
from legoworld.tracks.colmap import Camera
from legoworld.visibility.lens import distort

WORDS = [float(x) for x in COURTYARD.split()]
CAMERA = Camera(model="THIN_PRISM_FISHEYE", size_wh=(6048, 4032), params=tuple(WORDS[2:]))


def distorted_from_pinhole(params: tuple[float, ...], pinhole_xy_px: np.ndarray) -> np.ndarray:
    """The model forwards, scalar by scalar, from COLMAP's documentation."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx1, sy1 = params
    out = []
    for px, py in pinhole_xy_px:
        x, y = (px - cx) / fx, (py - cy) / fy
        r = np.hypot(x, y)
        stretch = np.arctan(r) / r if r > 0 else 1.0
        u, v = x * stretch, y * stretch
        r2 = u**2 + v**2
        radial = k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
        du = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u**2) + sx1 * r2
        dv = v * radial + 2 * p2 * u * v + p1 * (r2 + 2 * v**2) + sy1 * r2
        out.append([(u + du) * fx + cx, (v + dv) * fy + cy])
    return np.array(out)


def pixels(n: int, seed: int = 0) -> np.ndarray:
    """Random pixels of the photo, its corners and its principal point."""
    inner = np.random.default_rng(seed).uniform(0, 1, (n, 2)) * CAMERA.size_wh
    corners = [[0, 0], [6048, 0], [0, 4032], [6048, 4032], CAMERA.params[2:4]]
    return np.concatenate([inner, corners]).astype(np.float64)


def test_there_and_back_is_the_same_pixel() -> None:
    distorted = pixels(500)
    pinhole = pinhole_from_distorted(CAMERA, distorted)
    back = distorted_from_pinhole(CAMERA.params, pinhole)
    np.testing.assert_allclose(back, distorted, atol=1e-8)
    assert np.abs(pinhole - distorted).max() > 50  # the warp is worth doing


_RADIAL, _TANGENTIAL = st.floats(-0.04, 0.04), st.floats(-2e-3, 2e-3)


@settings(max_examples=50)
@given(
    bends=st.tuples(*[_RADIAL, _RADIAL, _TANGENTIAL, _TANGENTIAL] * 2),
    photo_xy=st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), max_size=20),
)
def test_other_coefficients_there_and_back(
    bends: tuple[float, ...], photo_xy: list[tuple[float, float]]
) -> None:
    bent = np.array(CAMERA.params[4:]) + bends
    camera = Camera(
        model="THIN_PRISM_FISHEYE", size_wh=CAMERA.size_wh, params=(*CAMERA.params[:4], *bent)
    )
    inner = np.array(photo_xy).reshape(-1, 2) * CAMERA.size_wh
    distorted = np.concatenate([inner, pixels(0)])
    back = distorted_from_pinhole(camera.params, pinhole_from_distorted(camera, distorted))
    np.testing.assert_allclose(back, distorted, atol=1e-8)


def test_the_partial_derivatives_are_those_of_the_distortion() -> None:
    coefficients = (0.3, -0.2, 0.05, -0.04, 0.1, 0.15, 0.02, -0.03)
    uv = np.random.default_rng(3).uniform(-0.7, 0.7, (9, 2))
    _, (f_u, f_v, g_u, g_v) = distort(uv, coefficients)
    step = 1e-6
    for axis, expected in enumerate(((f_u, g_u), (f_v, g_v))):
        moved = np.eye(2)[axis] * step
        ends = [distort(uv + sign * moved, coefficients)[0] for sign in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(slope.T, expected, rtol=1e-7, atol=1e-8)


def test_against_colmap_itself() -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    theirs = pycolmap.Camera(
        model="THIN_PRISM_FISHEYE", width=6048, height=4032, params=list(CAMERA.params)
    )
    distorted = pixels(2000, 5)
    pinhole = pinhole_from_distorted(CAMERA, distorted)
    fx, fy, cx, cy = CAMERA.params[:4]
    rays = theirs.cam_from_img(distorted)
    np.testing.assert_allclose(pinhole, rays * [fx, fy] + [cx, cy], atol=1e-6)
    ours = (pinhole - [cx, cy]) / [fx, fy]
    forward = theirs.img_from_cam(np.concatenate([ours, np.ones((len(ours), 1))], axis=1))
    np.testing.assert_allclose(forward, distorted, atol=1e-8)


def test_the_principal_point_stays_and_a_pinhole_changes_nothing() -> None:
    centre = np.array([CAMERA.params[2:4]])
    np.testing.assert_array_equal(pinhole_from_distorted(CAMERA, centre), centre)
    pinhole = Camera(model="PINHOLE", size_wh=(10, 10), params=(5, 5, 5, 5))
    np.testing.assert_array_equal(pinhole_from_distorted(pinhole, pixels(5)), pixels(5))


@pytest.mark.parametrize(
    ("model", "params"), [("OPENCV", (1.0,) * 8), ("THIN_PRISM_FISHEYE", (1.0,) * 8)]
)
def test_unknown_models_are_refused(model: str, params: tuple[float, ...]) -> None:
    with pytest.raises(CameraModelError, match=f"{model} with 8"):
        pinhole_from_distorted(Camera(model=model, size_wh=(4, 4), params=params), np.ones((1, 2)))


@pytest.mark.parametrize("k1", [-0.9, np.nan])
def test_a_distortion_that_cannot_be_inverted_is_an_error(k1: float) -> None:
    params = (*CAMERA.params[:4], k1, *(0.0,) * 7)
    with pytest.raises(CameraModelError, match="no ray"):
        pinhole_from_distorted(
            Camera(model="THIN_PRISM_FISHEYE", size_wh=(6048, 4032), params=params), pixels(10)
        )


def test_the_warp_reads_the_pinhole_where_the_distorted_pixel_looks() -> None:
    # A slanted plane seen by the pinhole; its disparity is linear in pinhole pixels, so what the
    # distorted pixel should read is known exactly from its ray.
    size_wh = (604, 403)
    small = [p / 10 for p in CAMERA.params[:4]] + list(CAMERA.params[4:])
    camera = Camera(model="THIN_PRISM_FISHEYE", size_wh=size_wh, params=tuple(small))
    y, x = np.mgrid[: size_wh[1], : size_wh[0]] + 0.5
    plane = 0.2 + 3e-4 * x + 5e-4 * y
    prediction = DepthArray(
        values=(1 / plane).astype(np.float64), space="depth", unit="m", intrinsics_px=None
    )
    rows, cols = (i.ravel() for i in np.mgrid[: size_wh[1], : size_wh[0]])
    warped = sampler(prediction, size_wh, camera_warp(camera, size_wh))(rows, cols)
    looked_at = pinhole_from_distorted(camera, np.stack([cols + 0.5, rows + 0.5], axis=1))
    inner = ((looked_at > 0.5) & (looked_at < np.array(size_wh) - 0.5)).all(axis=1)
    expected = 0.2 + looked_at @ [3e-4, 5e-4]
    assert warped.predicted[inner].all()
    np.testing.assert_allclose(warped.values[inner], expected[inner], rtol=1e-12)
    unwarped = sampler(prediction, size_wh, None)(rows, cols)
    assert np.abs(unwarped.values - expected)[inner].max() > 1e-3
    beyond = ((looked_at < -0.01) | (looked_at > np.array(size_wh) + 0.01)).any(axis=1)
    assert np.array_equal(warped.outside[beyond], np.ones(beyond.sum(), bool))
