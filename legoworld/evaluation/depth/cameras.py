"""The camera models of ETH3D's photos: from a distorted pixel to the pinhole's pixel."""

from __future__ import annotations

from typing import Final, cast

import numpy as np

from legoworld.evaluation.depth.errors import CameraModelError
from legoworld.evaluation.pixels.family import F64
from legoworld.pluralize import plural
from legoworld.tracks.colmap import Camera
from legoworld.visibility.lens import Coefficients, Lens, undistorted

#: Number of parameters by model, in the order of cameras.txt.
#: PINHOLE: fx fy cx cy; THIN_PRISM_FISHEYE: fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1.
PARAMETERS: Final = {"PINHOLE": 4, "THIN_PRISM_FISHEYE": 12}


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
    fx, fy, cx, cy = camera.params[:4]
    lens = Lens(coefficients=cast("Coefficients", camera.params[4:]), fisheye=True)
    found = undistorted(lens, (fx, fy), (cx, cy), distorted_xy_px)
    for pixels, why in (
        (found.folded, "the distortion folds over"),
        (found.unsolved, "the distortion has no inverse that is found"),
        (found.behind, "90 degrees or more off axis"),
    ):
        if pixels.any():
            raise CameraModelError(
                "the camera model has no ray for a pixel",
                found=f"{why} ({plural(int(np.count_nonzero(pixels)), 'pixel', 'pixels')})",
                expected="a distortion that is invertible over the whole image",
                next_step="check the parameters in cameras.txt, or score with --camera-model none",
            )
    return found.xy_px
