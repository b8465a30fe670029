"""depth.toml: declares the arrays of a folder whose files cannot declare it themselves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.evaluation.depth.arrays import SPACES, DepthTruthError, Intrinsics
from legoworld.evaluation.pixels.labelled import is_text, read_declared
from legoworld.files import Json

DECLARATION: Final = "depth.toml"


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """The declared content of a ground-truth folder's files; None where undeclared.

    space: depth | ray_distance | disparity; unit: m, mm or m/N of floats, mm, m/N, sun_rgbd or
    nyu_raw of 16-bit integers, px of a disparity; array: the name inside an .npz or .exr;
    intrinsics_px: fx, fy, cx, cy for ray_distance; focal_px, baseline_m, doffs_px: z = focal *
    baseline / (d + doffs) of a disparity; invalid_value: the integer that means "nothing
    measured", besides 0.
    """

    space: str | None = None
    unit: str | None = None
    array: str | None = None
    intrinsics_px: Intrinsics | None = None
    focal_px: float | None = None
    baseline_m: float | None = None
    doffs_px: float | None = None
    invalid_value: int | None = None


def read_declaration(folder: Path) -> Declaration:
    """The folder's depth.toml; an empty declaration without one. DepthTruthError if invalid."""
    values = read_declared(
        folder / DECLARATION,
        _FITS,
        expected=", ".join(sorted(_FITS)) + "; space " + " | ".join(SPACES),
        error=DepthTruthError,
    )
    if "intrinsics_px" in values:
        values["intrinsics_px"] = tuple(float(x) for x in values["intrinsics_px"])
    return Declaration(**values)


def _is_number(value: Json) -> bool:
    try:
        return isinstance(value, int | float) and type(value) is not bool and math.isfinite(value)
    except OverflowError:  # an integer that no float holds
        return False


_FITS: Final[dict[str, Callable[[Json], bool]]] = {
    "space": lambda value: value in SPACES,
    "unit": is_text,
    "array": is_text,
    "intrinsics_px": lambda value: (
        isinstance(value, list) and len(value) == 4 and all(map(_is_number, value))
    ),
    **dict.fromkeys(("focal_px", "baseline_m", "doffs_px"), _is_number),
    "invalid_value": lambda value: type(value) is int and 0 <= value <= 65535,
}
