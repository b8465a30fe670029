"""Depth on a page: the main metrics, and the section with its photos."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from legoworld.evaluation.depth.family import PIXELS
from legoworld.records.depth import DepthSummary
from legoworld.records.evaluation_view import DepthView
from legoworld.records.report_page import DepthCell, DepthPageView
from legoworld.report.depth_images import (
    DepthPlots,
    depth_advice,
    depth_cell,
    depth_facts,
    depth_view,
)
from legoworld.report.pixel_section import PixelPage, Views, pixel_page
from legoworld.report.tables import depth_rows

_METRICS: Final = {
    "abs_rel.error_1": "AbsRel",
    "abs_rel.exclude": "AbsRel, holes left out",
    "delta1.error_1": "delta1",
    "delta2.error_1": "delta2",
    "delta3.error_1": "delta3",
}


def _panes(views: Views) -> Mapping[str, Any]:
    return {"depth": depth_view(views)}


def _notes(summary: DepthSummary) -> list[str]:
    return [
        f"mean share of holes {_number(summary.mean_hole_share)}, outside the view "
        f"{_number(summary.mean_outside_view_share)}, clamped "
        f"{_number(summary.mean_clamped_share)}",
        f"{summary.resampled} resampled, {summary.worse_than_constant} worse than a constant",
    ]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


PAGE: Final = pixel_page(
    PixelPage(
        family=PIXELS,
        names=_METRICS,
        view=DepthView,
        page_view=DepthPageView,
        panes=_panes,
        facts=depth_facts,
        advice=depth_advice,
        cell=DepthCell,
        cell_fields=depth_cell,
        head=depth_rows,
        notes=_notes,
        plots=DepthPlots,
    )
)
