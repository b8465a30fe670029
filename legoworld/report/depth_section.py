"""The depth of a page: a list of photos, a view of each, and errors against depth."""

from __future__ import annotations

import math

from msgspec.structs import replace

from legoworld.records.base import UNSET
from legoworld.records.depth import DepthRow, ScoredDepthRow
from legoworld.records.report_page import Answer, DepthCell, DepthPageView, PhotoRow
from legoworld.records.report_summary import Plots
from legoworld.records.report_tables import PageSection
from legoworld.report.depth_images import DepthImage, depth_advice, depth_images
from legoworld.report.facts import run_facts, run_tables
from legoworld.report.page_content import PageDocument, Photos
from legoworld.report.photo_order import in_order
from legoworld.report.plots import DepthPixels
from legoworld.report.sources import Section
from legoworld.report.tables import depth_rows


def depth_section(
    section: Section, made: PageSection, document: PageDocument, places: Photos
) -> PageSection:
    """A section with its photos; their views go into the document."""
    rows: list[tuple[float, PhotoRow]] = []
    pixels = [DepthPixels() for _ in section.sides]
    places.read([(row.file_name, None) for row in section.sides[0].rows])
    for image in depth_images(section.sides):
        view = _view(section, image, document, places)
        # Without a score of the first side first, then its largest error.
        first = image.rows[0]
        error = math.inf
        if isinstance(first, ScoredDepthRow):
            error = first.metrics["abs_rel"]["error_1"]
        rows.append((-error, _row(image, view, len(document.views))))
        document.views.append(view)
        for mine, aligned in zip(pixels, image.aligned_z_m, strict=True):
            if image.truth_z_m is not None and aligned is not None:
                mine.add(image.truth_z_m, aligned)
    plots = (p.plot(side.name) for p, side in zip(pixels, section.sides, strict=True))
    return replace(
        made,
        head=tuple(depth_rows(section.sides)),
        images=in_order(rows),
        names={},
        plots=Plots(depth_error=tuple(plot for plot in plots if plot)),
    )


def _view(
    section: Section, image: DepthImage, document: PageDocument, places: Photos
) -> DepthPageView:
    first = image.rows[0]
    photo, said = places.place(first.file_name, None)
    return DepthPageView(
        section=section.key,
        id=first.image_id,
        file_name=first.file_name,
        size_wh=first.truth_wh,
        photo=photo,
        said=said,
        depth=image.view,
        sides=tuple(
            Answer(
                label=side.name,
                status=row.status,
                facts=(*run_facts(run_row, scene), *_fit_facts(row)),
                tables=tuple(run_tables(run_row)),
                advice=depth_advice(row, run_row, scene=side.is_scene),
                scene=document.scenes.page_scene(scene, run_row) if side.is_scene else None,
            )
            for side, row, run_row, scene in zip(
                section.sides, image.rows, image.run_rows, image.scenes, strict=True
            )
        ),
    )


def _fit_facts(row: DepthRow) -> list[tuple[str, str]]:
    """How the depth was aligned and what it scored, as text."""
    facts = [("valid ground truth", f"{row.n_valid} px of {row.truth_wh[0]}x{row.truth_wh[1]}")]
    if not isinstance(row, ScoredDepthRow):
        return facts
    facts.append(("fit", f"1/z = {row.s:.6g} x + {row.t:.6g}, x in {row.space}"))
    facts.append(("holes", f"{row.hole_share:.2%} of the valid ground truth"))
    for metric, values in row.metrics.items():
        text = ", ".join(f"{policy} {value:.4f}" for policy, value in values.items())
        facts.append((metric, text))
    return facts


def _row(image: DepthImage, view: DepthPageView, at: int) -> PhotoRow:
    cells = []
    for row, drawn in zip(image.rows, view.sides, strict=True):
        scored = row if isinstance(row, ScoredDepthRow) else None
        cells.append(
            DepthCell(
                status=row.status,
                abs_rel=scored.metrics["abs_rel"] if scored else None,
                delta1=scored.metrics["delta1"]["error_1"] if scored else None,
                constant=scored.constant["abs_rel"]["error_1"] if scored else None,
                holes=None if row.hole_share is UNSET else row.hole_share,
                advice=drawn.advice[0].what if drawn.advice else "",
                findings=sum(a.level == "bad" for a in drawn.advice),
            )
        )
    return PhotoRow(
        id=view.id,
        file_name=view.file_name,
        view=at,
        n_truth=image.rows[0].n_valid,
        cells=tuple(cells),
        categories=(),
    )
