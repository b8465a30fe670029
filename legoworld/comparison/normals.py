"""Normals compared: means over images."""

from __future__ import annotations

from typing import Final

from legoworld.comparison.pixels import Missing, PixelComparison, pixel_comparison
from legoworld.evaluation.normals.family import PIXELS
from legoworld.evaluation.normals.protocol import METRICS

COMPARISON: Final = pixel_comparison(
    PixelComparison(
        family=PIXELS,
        missing=Missing(
            metric=METRICS[0].name,
            value=lambda summary: float(summary.all_attempted.missing_deg),
        ),
        extra=lambda _rows, _name, _policy: {},
        facts=lambda _side, facts: facts,
        differences=lambda _first, _other: [],
        notes=lambda _sides: [],
    )
)
