"""The order a page lists its photos in."""

from __future__ import annotations

from collections.abc import Sequence

from legoworld.records.report_page import PhotoRow


def in_order(rows: Sequence[tuple[float, PhotoRow]]) -> tuple[PhotoRow, ...]:
    """By the number beside each, then by id."""
    return tuple(row for _, row in sorted(rows, key=lambda one: (one[0], one[1].id)))
