"""Errors of depth files."""

from __future__ import annotations

from legoworld.errors import LegoWorldError
from legoworld.evaluation.pixels.errors import pixel_errors

DepthTruthError, DepthPredictionError, DepthMissingError, DepthUnseenError = ERRORS = pixel_errors(
    "depth", __name__
)


class CameraModelError(LegoWorldError):
    """A camera model is unknown, or has no ray for a pixel."""

    code = "camera_model"
