"""depth.toml: declares the arrays of a folder whose files cannot declare it themselves."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

from legoworld.errors import cause
from legoworld.evaluation.depth.arrays import SPACES, Intrinsics
from legoworld.evaluation.depth.errors import DepthTruthError
from legoworld.files import Json, utf8_text, write_text

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
    path = folder / DECLARATION
    if not path.is_file():
        return Declaration()
    try:
        values = tomllib.loads(utf8_text(path.read_bytes()))
    except (OSError, ValueError, RecursionError) as error:
        raise DepthTruthError(f"{DECLARATION} cannot be read", found=cause(error)) from error
    known = {f.name for f in fields(Declaration)}
    wrong = [key for key in values if key not in known]
    wrong += [key for key, value in values.items() if key in known and not _fits(key, value)]
    if wrong:
        raise DepthTruthError(
            f"{DECLARATION} has an unknown key or value",
            found=f"{wrong[0]} = {values[wrong[0]]!r}",
            expected=", ".join(sorted(known)) + "; space " + " | ".join(SPACES),
        )
    if "intrinsics_px" in values:
        values["intrinsics_px"] = tuple(float(x) for x in values["intrinsics_px"])
    return Declaration(**values)


def write_declaration(folder: Path, declared: Declaration) -> str:
    """Write space and unit as the folder's depth.toml; returns its text."""
    pairs = (("space", declared.space), ("unit", declared.unit))
    text = "".join(f'{key} = "{value}"\n' for key, value in pairs if value is not None)
    write_text(folder / DECLARATION, text)
    return text


def _fits(key: str, value: Json) -> bool:
    if key == "space":
        return value in SPACES
    if key in ("unit", "array"):
        return isinstance(value, str)
    if key == "invalid_value":
        return type(value) is int and 0 <= value <= 65535
    if key == "intrinsics_px":
        return isinstance(value, list) and len(value) == 4 and all(map(_is_number, value))
    return _is_number(value)


def _is_number(value: Json) -> bool:
    try:
        return isinstance(value, int | float) and type(value) is not bool and math.isfinite(value)
    except OverflowError:  # an integer that no float holds
        return False
