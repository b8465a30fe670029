"""Pieces of the few lines that an evaluation prints: who scored, how many images, numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from legoworld.pluralize import plural
from legoworld.records.evaluation_summary import Coverage, Interval, Summary
from legoworld.tables.table import Number

#: Maximum number of lines of one kind.
_SHORT: Final = 3


def describe_evaluator(summary: Summary) -> str:
    """The evaluator and its version."""
    return f"{summary.evaluator.name} {summary.evaluator.version}"


def image_counts(coverage: Coverage) -> str:
    """Images attempted, scored and with truth."""
    return (
        f"{plural(coverage.attempted, 'image', 'images')} attempted, {coverage.scored} "
        f"scored, {coverage.with_truth} with truth"
    )


def fraction(value: float | None) -> str:
    """A number with four digits, "-" where it is undefined."""
    return str(Number(value=value))


def bounds(interval: Interval | None) -> str:
    """An interval after a space, "" without one."""
    ends = interval.ends if interval else None
    return f" {Number(value=None, ends=ends).spread}" if ends else ""


def first_few(lines: Sequence[str], one: str, many: str) -> list[str]:
    """The first lines of one kind, and how many more there are."""
    if len(lines) <= _SHORT:
        return [*lines]
    more = plural(len(lines) - _SHORT, f"more {one}", f"more {many}")
    return [*lines[:_SHORT], f"... and {more} (-v lists all)"]
