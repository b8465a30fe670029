"""Normals on a page: the main metrics, means over images, above the tables."""

from __future__ import annotations

from typing import Final

from legoworld.report.family import PageFamily

PAGE: Final = PageFamily(
    forest={
        "mean_deg.error_90": "mean error",
        "mean_deg.exclude": "mean error, holes left out",
        "median_deg.error_90": "median error",
        "below_11_25.fails": "below 11.25",
        "below_22_5.fails": "below 22.5",
        "below_30.fails": "below 30",
    }
)
