"""The articulation pilot's provisional card, held to what the code does."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from legoworld.errors import InstallationError
from legoworld.files import sha256_of_file
from legoworld.records.articulation import JOINT_TYPES
from legoworld.shipped import catalog

_FIXED: Final[dict[str, dict[str, Any]]] = {
    "pilot": {"name": "articulation", "task": "bench", "status": "provisional"},
    "joints": {
        "types": list(JOINT_TYPES),
        "property": "joint",
        "property_axis": [0.0, 0.0, 1.0],
        "urdf_root": "object_or_world",
        "limits": "recorded",
    },
    "matching": {"frame": "camera", "assignment": "largest_sum"},
    "scoring": {
        "score": "2C / (2C + O + P + J + 2W + E)",
        "continuous": "revolute",
        "not_valid": "object_missing",
    },
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
    path = catalog.folder("readouts") / "pilots" / "articulation.toml"
    with path.open("rb") as stream:
        values = tomllib.load(stream)
    for table, fixed in _FIXED.items():
        for key, expected in fixed.items():
            if values[table][key] != expected:
                raise InstallationError(
                    f"{path.name} declares what the code does not do",
                    found=f"{table}.{key} = {values[table][key]!r}",
                    expected=f"{table}.{key} = {expected!r}",
                    next_step="restore the card",
                )
    matching, scoring = values["matching"], values["scoring"]
    return ArticulationRules(
        version=values["pilot"]["version"],
        sha256=sha256_of_file(path),
        box_pad=float(matching["box_pad"]),
        min_box_iou=float(matching["min_box_iou"]),
        present_recall=float(scoring["present_recall"]),
        max_axis_deg=float(scoring["max_axis_deg"]),
        max_axis_apart=float(scoring["max_axis_apart"]),
    )
