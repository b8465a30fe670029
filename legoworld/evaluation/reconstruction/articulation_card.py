"""The articulation pilot's provisional card, held to what the code does."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from legoworld.cards import read_values
from legoworld.records.bench_dataset import JOINT_TYPES
from legoworld.shipped import catalog

_CARD: Final = "pilots/articulation"
_FIXED: Final[dict[str, Any]] = {
    "pilot.name": "articulation",
    "pilot.task": "bench",
    "pilot.status": "provisional",
    "joints.types": list(JOINT_TYPES),
    "joints.property": "joint",
    "joints.property_axis": [0.0, 0.0, 1.0],
    "joints.urdf_root": "object_or_world",
    "joints.limits": "recorded",
    "matching.frame": "camera",
    "matching.assignment": "largest_sum",
    "scoring.score": "2C / (2C + O + P + J + 2W + E)",
    "scoring.continuous": "revolute",
    "scoring.not_valid": "object_missing",
}


@dataclass(frozen=True, kw_only=True)
class ArticulationRules:
    """The card's numbers. box_pad, max_axis_apart: shares of the reference part's depth."""

    version: str
    sha256: str
    box_pad: float
    min_box_iou: float
    present_recall: float
    max_axis_deg: float
    max_axis_apart: float


@cache
def articulation_rules() -> ArticulationRules:
    """The shipped card. InstallationError when a fixed value is not the code's."""
    card = read_values(catalog.folder("readouts") / f"{_CARD}.toml", _CARD)
    card.hold_to(_FIXED)
    return ArticulationRules(
        version=card.value("pilot.version"),
        sha256=card.sha256,
        box_pad=float(card.value("matching.box_pad")),
        min_box_iou=float(card.value("matching.min_box_iou")),
        present_recall=float(card.value("scoring.present_recall")),
        max_axis_deg=float(card.value("scoring.max_axis_deg")),
        max_axis_apart=float(card.value("scoring.max_axis_apart")),
    )
