"""An evaluation of arrays as text: what every family says alike."""

from __future__ import annotations

from typing import Any, cast

from legoworld.evaluation.metrics import MetricRow, number
from legoworld.evaluation.short_text import first_few
from legoworld.pluralize import plural
from legoworld.records.pixels import PixelSummary


def list_unscored(summary: PixelSummary) -> list[str]:
    """A line for each image without a score."""
    return [f"{r.status}: {r.file_name}: {r.reason}" for r in summary.not_scored]


def list_few_unscored(summary: PixelSummary) -> list[str]:
    """The first of these."""
    return first_few(list_unscored(summary), "image without a score", "images without a score")


def attempted_rows(summary: PixelSummary, metric: str) -> list[MetricRow]:
    """A metric over every image with truth."""
    every = cast("Any", summary).all_attempted
    images = plural(every.images, "image", "images")
    given = getattr(every, f"missing_{metric}")
    over = f"{images} with truth, {every.missing} of them without a score at {given:g}"
    return [
        MetricRow(name=f"{metric}, all attempted", policy=policy, number=number(value), over=over)
        for policy, value in getattr(every, metric).items()
    ]
