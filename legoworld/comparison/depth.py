"""Depth compared: camera models, calibration, and the constant beside every mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from legoworld.comparison.family import SideFacts
from legoworld.comparison.pixels import PixelComparison, pixel_comparison
from legoworld.evaluation.depth.family import PIXELS
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.base import as_json, to_record
from legoworld.records.depth import ScoredDepthRow
from legoworld.records.evaluation import DepthRules


def _constant(rows: Sequence[ScoredDepthRow], name: str, policy: str) -> Mapping[str, float]:
    """The mean of the zero-information constant, on the same pixels."""
    values = [row.constant[name][policy] for row in rows]
    return {"constant": float(np.mean(np.array(values, np.float64))) if values else float("nan")}


def _camera_model(side: StoredEvaluation) -> str:
    """How a scene's depth was read: none or dataset."""
    return side.depth.protocol.camera_model


def _facts(side: StoredEvaluation, facts: SideFacts) -> SideFacts:
    """The declared choices of depth; each method has its own camera model."""
    return replace(
        facts,
        protocol=to_record(DepthRules, as_json(side.depth.protocol)),
        camera_model=_camera_model(side),
    )


def _differences(first: StoredEvaluation, other: StoredEvaluation) -> list[str]:
    """Cameras that make depths incomparable (docs/protocols/comparison.md)."""
    differences = []
    if first.is_scene and other.is_scene and _camera_model(first) != _camera_model(other):
        differences.append(f"camera model {_camera_model(first)} and {_camera_model(other)}")
    if _camera_model(first) == _camera_model(other) == "dataset":
        ours, theirs = (_calibration(s) for s in (first, other))
        if ours != theirs:
            differences.append("calibration")
    return differences


def _calibration(side: StoredEvaluation) -> list[str]:
    return [e.sha256 for e in side.evidence.inputs if e.role == "calibration"]


def _notes(sides: Sequence[StoredEvaluation]) -> list[str]:
    models = {s.name: _camera_model(s) for s in sides}
    if set(models.values()) == {"none"}:
        return []
    listed = ", ".join(f"{name} {model}" for name, model in models.items())
    return [
        f"Camera model: {listed}. A scene's pinhole view is warped to the distorted photo that "
        "the other methods saw."
    ]


#: What is compared of depth.
COMPARED: Final = PixelComparison(
    family=PIXELS, extra=_constant, facts=_facts, differences=_differences, notes=_notes
)
COMPARISON: Final = pixel_comparison(COMPARED)
