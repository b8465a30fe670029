"""Errors of depth files: one in ground truth ends scoring, one in a prediction is its row."""

from __future__ import annotations

from legoworld import exit_codes
from legoworld.errors import LegoWorldError


class DepthTruthError(LegoWorldError):
    """The ground truth is missing, undeclared or contradicts the track: nothing can be scored."""

    code = "depth_truth"


class DepthPredictionError(LegoWorldError):
    """A predicted depth array cannot be scored."""

    code = "depth_prediction"
    status = "invalid"


class DepthMissingError(LegoWorldError):
    """The run has no depth file for an image."""

    code = "depth_missing"
    status = "missing"


class DepthUnseenError(LegoWorldError):
    """A machine of the cluster does not see the same files as the command."""

    code = "depth_unseen"
    exit_code = exit_codes.BLOCKED


class CameraModelError(LegoWorldError):
    """A camera model is unknown, or has no ray for a pixel."""

    code = "camera_model"
