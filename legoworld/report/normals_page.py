"""Normals on a page: the main metrics, means over images, and the section with its photos."""

from __future__ import annotations

from typing import Final

from legoworld.records.normals import NormalsView
from legoworld.records.report_page import NormalsPageView
from legoworld.report.normals_images import MENDING, normals_advice, normals_drawing, normals_facts
from legoworld.report.pixel_section import PixelPage, pixel_page

_METRICS: Final = {
    "mean_deg.error_90": "mean error",
    "mean_deg.exclude": "mean error, holes left out",
    "median_deg.error_90": "median error",
    "below_11_25.fails": "below 11.25",
    "below_22_5.fails": "below 22.5",
    "below_30.fails": "below 30",
}

PAGE: Final = pixel_page(
    PixelPage(
        names=_METRICS,
        view=NormalsView,
        page_view=NormalsPageView,
        drawing=("normals", normals_drawing),
        facts=normals_facts,
        advice=normals_advice,
        mending=MENDING,
    )
)
