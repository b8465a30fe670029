"""Depth on a page: the main metrics, and the section with its photos."""

from __future__ import annotations

from typing import Final

from legoworld.records.depth import DepthView
from legoworld.records.report_page import DepthPageView
from legoworld.report.depth_images import (
    MENDING,
    DepthPlots,
    depth_advice,
    depth_constant,
    depth_facts,
    depth_view,
)
from legoworld.report.pixel_section import PixelPage, pixel_page

_METRICS: Final = {
    "abs_rel.error_1": "AbsRel",
    "abs_rel.exclude": "AbsRel, holes left out",
    "delta1.error_1": "delta1",
    "delta2.error_1": "delta2",
    "delta3.error_1": "delta3",
}

PAGE: Final = pixel_page(
    PixelPage(
        names=_METRICS,
        view=DepthView,
        page_view=DepthPageView,
        drawing=("depth", depth_view),
        facts=depth_facts,
        advice=depth_advice,
        mending=MENDING,
        constant=depth_constant,
        plots=DepthPlots,
    )
)
