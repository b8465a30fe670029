"""What can be wrong with depth files: the truth's faults end a scoring, a prediction's are rows."""

from __future__ import annotations

from legoworld.errors import LegoWorldError


class DepthFileError(LegoWorldError):
    """A depth file cannot be read as what it says it is."""

    code = "depth_file"
    status = "invalid"


class DepthTruthError(LegoWorldError):
    """The truth is absent, unlabelled, or contradicts the track: nothing can be scored."""

    code = "depth_truth"


class DepthPredictionError(LegoWorldError):
    """A predicted depth array cannot be scored."""

    code = "depth_prediction"
    status = "invalid"


class DepthMissingError(LegoWorldError):
    """The run has no depth file for an image."""

    code = "depth_missing"
    status = "missing"


class CameraModelError(LegoWorldError):
    """A camera model is unknown, or a pixel has no ray under it."""

    code = "camera_model"
