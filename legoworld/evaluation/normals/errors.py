"""Errors of normals."""

from __future__ import annotations

from legoworld.evaluation.pixels.errors import pixel_errors

NormalsTruthError, NormalsPredictionError, NormalsMissingError, NormalsUnseenError = ERRORS = (
    pixel_errors("normals", __name__)
)
