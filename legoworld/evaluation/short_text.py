"""Pieces of the few lines that an evaluation prints: who scored, how many images, numbers."""

from __future__ import annotations

from typing import Final

from legoworld.pluralize import counted
from legoworld.records.evaluation_summary import Coverage, Interval, Summary

#: Maximum number of lines of one kind.
SHORT: Final = 3


def evaluator_of(summary: Summary) -> str:
    """The evaluator and its version."""
    return f"{summary.evaluator.name} {summary.evaluator.version}"


def image_counts(coverage: Coverage) -> str:
    """Images attempted, scored and with truth."""
    return (
        f"{counted(coverage.attempted, 'image', 'images')} attempted, {coverage.scored} "
        f"scored, {coverage.with_truth} with truth"
    )


def fraction(value: float | None) -> str:
    """A number with four digits, "-" where it is undefined."""
    return "-" if value is None else f"{value:.4f}"


def bounds(interval: Interval | None) -> str:
    """An interval after a space, "" without one."""
    return " [{:.4f}, {:.4f}]".format(*interval.ends) if interval and interval.ends else ""
