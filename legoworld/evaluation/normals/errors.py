"""Errors of normals: one in ground truth ends scoring, one in a prediction is its row."""

from __future__ import annotations

from legoworld import exit_codes
from legoworld.errors import LegoWorldError


class NormalsTruthError(LegoWorldError):
    """The ground truth is missing, undeclared or contradicts the track: nothing can be scored."""

    code = "normals_truth"


class NormalsPredictionError(LegoWorldError):
    """A predicted array of normals cannot be scored."""

    code = "normals_prediction"
    status = "invalid"


class NormalsMissingError(LegoWorldError):
    """The run has no file of normals for an image."""

    code = "normals_missing"
    status = "missing"


class NormalsUnseenError(LegoWorldError):
    """A machine of the cluster does not see the same files as the command."""

    code = "normals_unseen"
    exit_code = exit_codes.BLOCKED
