"""Means over cases: zeros included beside the valid alone, with intervals over families."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from legoworld.evaluation.bootstrap import GroupDraws, draw_groups, interval
from legoworld.records.reconstruction import (
    COMPARED,
    Group,
    Groups,
    Mean,
    Means,
    Over,
    ReconstructionRow,
)

#: What a family without the property is grouped under.
UNSTATED: Final = "unstated"
_TIERS: Final = ("easy", "medium", "hard")
Value = Callable[[ReconstructionRow], float | None]


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A number of each case. over: attempted counts every case, valid those with V = 1 alone."""

    name: str
    over: Over
    value: Value


#: The second card's numbers of a case, in the order they are shown.
SECOND: Final = ("R_p", "R_x", "A_x", "F3D", "found", "R_empty", "R_above_empty")


def headline(tolerances: Sequence[str], *, second: bool = False) -> tuple[Measure, ...]:
    """V, R, A, S and F at the other tolerances over all attempted; R, A, S over the valid.

    second: the second card's, too.
    """

    def at(name: str) -> Value:
        return lambda row: row.R_at[name] if row.valid else 0.0

    return (
        Measure(name="V", over="attempted", value=lambda row: float(row.valid)),
        Measure(name="R", over="attempted", value=lambda row: row.R),
        Measure(name="A", over="attempted", value=lambda row: row.A),
        Measure(name="S", over="attempted", value=lambda row: row.S),
        Measure(name="R_valid", over="valid", value=lambda row: row.R),
        Measure(name="A_valid", over="valid", value=lambda row: row.A),
        Measure(name="S_valid", over="valid", value=lambda row: row.S),
        *(Measure(name=name, over="attempted", value=at(name)) for name in tolerances),
        *(Measure(name=n, over="attempted", value=_second(n)) for n in SECOND if second),
    )


def _second(name: str) -> Value:
    def value(row: ReconstructionRow) -> float | None:
        found: float | None = getattr(row.x, name) if row.x else None
        return found

    return value


def compute_mean(
    measure: Measure, rows: Sequence[ReconstructionRow], draws: GroupDraws | None = None
) -> Mean:
    """A measure's mean. Undefined where there is no case, or a case that lacks the number.

    No interval without draws, or over a single family.
    """
    some = [row for row in rows if measure.over == "attempted" or row.valid]
    values = [measure.value(row) for row in some]
    defined = [value for value in values if value is not None]
    if not defined or len(defined) < len(values):
        return Mean(value=None, n=len(values), over=measure.over, interval=None)
    numbers = np.array(defined, np.float64)
    return Mean(
        value=float(np.mean(numbers)),
        n=len(defined),
        over=measure.over,
        interval=None
        if draws is None or not draws.spread
        else interval(draws.means(numbers, [row.family for row in some]), unit="family"),
    )


def compute_means(
    measures: Sequence[Measure], rows: Sequence[ReconstructionRow], draws: GroupDraws | None
) -> Means:
    """Every measure's mean, by name."""
    return {measure.name: compute_mean(measure, rows, draws) for measure in measures}


def diagnostic_means(rows: Sequence[ReconstructionRow]) -> Means:
    """Means of diagnostics over the valid cases that have them, each with its own denominator."""
    valid = [row for row in rows if row.valid and row.status == COMPARED]
    by_name: dict[str, list[float]] = {}
    for row in valid:
        for name, value in _diagnostics(row).items():
            if value is not None:
                by_name.setdefault(name, []).append(value)
    return {
        name: Mean(value=float(np.mean(values)), n=len(values), over="valid", interval=None)
        for name, values in sorted(by_name.items())
    }


def _diagnostics(row: ReconstructionRow) -> dict[str, float | None]:
    values: dict[str, float | None] = {}
    if row.diagnostics is not None:
        for name in row.diagnostics.__struct_fields__:
            value = getattr(row.diagnostics, name)
            values[name] = value if value is None or isinstance(value, float) else value.f1
    if row.fov_error_deg is not None:
        values["fov_error_deg_absolute"] = abs(row.fov_error_deg)
    if row.camera is not None and row.camera.registration is not None:
        values["registration_rotation_deg"] = row.camera.registration.rotation_deg
        values["registration_translation_m"] = row.camera.registration.translation_m
    if row.appearance is not None:
        values["A_where_geometry_agrees"] = row.appearance.where_geometry_agrees
        values["A_where_geometry_differs"] = row.appearance.where_geometry_differs
    return values


def compute_group_means(
    measures: Sequence[Measure], rows: Sequence[ReconstructionRow], draws: int, seed: int
) -> Groups:
    """The same means in every group; a group's intervals are over its own families."""

    def grouped(key: Callable[[ReconstructionRow], str | None]) -> dict[str, Group]:
        by_value: dict[str, list[ReconstructionRow]] = {}
        for row in rows:
            by_value.setdefault(key(row) or UNSTATED, []).append(row)
        return {
            name: _group(measures, by_value[name], draws, seed)
            for name in sorted(by_value, key=group_order)
        }

    return Groups(
        tier=grouped(lambda row: row.tier),
        split=grouped(lambda row: row.split),
        environment=grouped(lambda row: row.environment),
        theme=grouped(lambda row: row.theme),
        family=grouped(lambda row: row.family),
    )


def _group(
    measures: Sequence[Measure], rows: Sequence[ReconstructionRow], draws: int, seed: int
) -> Group:
    drawn = draw_groups([row.family for row in rows], draws, seed)
    return Group(
        cases=len(rows),
        families=len(drawn.column),
        metrics=compute_means(measures, rows, drawn),
    )


def group_order(name: str) -> tuple[int, str]:
    """Easy, medium, hard; other names by themselves."""
    return (_TIERS.index(name) if name in _TIERS else len(_TIERS)), name


def mean_and_sd(values: Sequence[float]) -> tuple[float, float | None]:
    """Over repeated runs: the mean, and the standard deviation with ddof = 1 of two or more."""
    numbers = np.array(values, np.float64)
    return float(np.mean(numbers)), float(np.std(numbers, ddof=1)) if len(numbers) > 1 else None
