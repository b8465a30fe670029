"""A page's section of one array for each image: a list of photos, and a view of each."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, cast

from msgspec.structs import replace

from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.base import UNSET
from legoworld.records.pixels import PixelRow
from legoworld.records.report_page import Advice, Answer, PageView, PhotoRow, PixelCell
from legoworld.records.report_tables import PageSection, PixelList, Plots
from legoworld.records.run_rows import RunRow
from legoworld.report.advice import failure_advice, sorted_advice
from legoworld.report.costs import side_costs
from legoworld.report.facts import run_facts, run_tables
from legoworld.report.family import PageFamily
from legoworld.report.first_screen import first_screen
from legoworld.report.mended_pixels import (
    Mending,
    Regions,
    costliest,
    photo_mended,
    pixel_findings,
)
from legoworld.report.page_content import PageDocument, Photos
from legoworld.report.photo_order import in_order
from legoworld.report.sources import Section

#: The stored view of one photo for each side; None where it has no score.
Views = Sequence[Any]


class PixelPlots(Protocol):
    """What is plotted of a section, photo by photo."""

    def add(self, views: Views) -> None:
        """One photo."""
        ...

    def plots(self, names: Sequence[str]) -> Plots:
        """Of the sides by these names."""
        ...


@dataclass(frozen=True, kw_only=True)
class PixelPage:
    """How a family's photos are shown.

    names: the main metrics, as comparisons call them, with the page's names; the first is in
    sentences, and photos are listed by it. view: the type of view/ID.json; page_view: that of the
    page's views; drawing: its field of what is drawn, and what makes that of the sides' views.
    facts: of a row with numbers, before its metrics; advice: on it; mending: what its errors cost;
    constant: the score of a constant, where there is one. plots: made anew for each section.
    """

    names: Mapping[str, str]
    view: type[Any]
    page_view: Callable[..., PageView]
    drawing: tuple[str, Callable[[Views], Any]]
    facts: Callable[[Any], list[tuple[str, str]]]
    advice: Callable[[Any], list[Advice]]
    mending: Mending
    constant: Callable[[Any], float] | None = None
    plots: Callable[[int], PixelPlots] | None = None

    @property
    def first(self) -> tuple[str, str]:
        """Name and hole policy of the first metric."""
        name, _, policy = next(iter(self.names)).partition(".")
        return name, policy


def pixel_page(page: PixelPage) -> PageFamily:
    """The page of a family."""
    return PageFamily(forest=page.names, fill=partial(pixel_section, page))


def pixel_section(
    page: PixelPage, section: Section, draft: PageSection, document: PageDocument, places: Photos
) -> PageSection:
    """A section with its photos; their views go into the document."""
    rows: list[tuple[float, PhotoRow]] = []
    plots = page.plots(len(section.sides)) if page.plots else None
    places.read([(row.file_name, None) for row in section.sides[0].rows])
    name, policy = page.first
    mended = costliest(page.first, section.sides)
    regions: list[dict[int, Regions]] = [{} for _ in section.sides]
    for of_sides in zip(*(side.rows for side in section.sides), strict=True):
        image = cast("tuple[PixelRow, ...]", of_sides)
        views = [side.image_view(page.view, image[0].image_id) for side in section.sides]
        view = _view(page, section, image, views, document, places)
        # Without a score of the first side first, then its largest error.
        scores = image[0].scores
        error = scores[name][policy] if scores else math.inf
        rows.append((-error, _row(page, image, view, len(document.views))))
        document.views.append(view)
        if plots is not None:
            plots.add(views)
        for found, stored in zip(regions, views, strict=True):
            if stored is not None and view.id in mended:
                found[view.id] = photo_mended(page.mending, section.task, stored)
    metric = next(iter(page.names.values())), name, policy
    costs = [
        pixel_findings(page.mending, metric, *of) for of in zip(section.sides, regions, strict=True)
    ]
    return replace(
        draft,
        first=first_screen(section, side_costs(costs)),
        images=in_order(rows),
        names={},
        pixels=PixelList(
            metric=next(iter(page.names.values())),
            policy=policy,
            constant=page.constant is not None,
        ),
        plots=plots.plots([side.name for side in section.sides]) if plots else draft.plots,
    )


def _view(
    page: PixelPage,
    section: Section,
    rows: Sequence[PixelRow],
    views: Views,
    document: PageDocument,
    places: Photos,
) -> PageView:
    first = rows[0]
    photo, said = places.place(first.file_name, None)
    return page.page_view(
        section=section.key,
        id=first.image_id,
        file_name=first.file_name,
        size_wh=first.truth_wh,
        photo=photo,
        said=said,
        sides=tuple(
            _answer(page, side, row, document)
            for side, row in zip(section.sides, rows, strict=True)
        ),
        **{page.drawing[0]: page.drawing[1](views)},
    )


def _answer(
    page: PixelPage, side: StoredEvaluation, row: PixelRow, document: PageDocument
) -> Answer:
    run_row, source = side.run_rows[row.image_id], side.source(row.image_id)
    valid = f"{row.n_valid} px of {row.truth_wh[0]}x{row.truth_wh[1]}"
    return Answer(
        label=side.name,
        status=row.status,
        facts=(
            *run_facts(run_row, source),
            ("valid ground truth", valid),
            *(page.facts(row) if row.has_score else ()),
            *_numbers(row),
        ),
        tables=tuple(run_tables(run_row)),
        advice=_advice(page, row, run_row, scene=side.is_scene),
        scene=document.scenes.page_scene(source, run_row) if side.is_scene else None,
    )


def _advice(page: PixelPage, row: PixelRow, run_row: RunRow, *, scene: bool) -> tuple[Advice, ...]:
    """Everything to say of one side's array of a photo; what to do only where it is a scene."""
    advice = failure_advice(run_row)
    if not advice and row.has_score:
        advice += page.advice(row)
    elif not advice:
        advice.append(Advice(level="bad", what=f"not scored ({row.status}): {row.reason}"))
    if not scene:
        advice = [replace(a, do="") for a in advice]
    warnings = {*row.warnings, *run_row.warnings}
    advice += [Advice(level="warn", what=str(w)) for w in sorted(warnings)]
    return sorted_advice(advice)


def _numbers(row: PixelRow) -> list[tuple[str, str]]:
    """The metrics of a row, by hole policy."""
    return [
        (metric, ", ".join(f"{policy} {value:.4f}" for policy, value in values.items()))
        for metric, values in (row.scores or {}).items()
    ]


def _row(page: PixelPage, rows: Sequence[PixelRow], view: PageView, at: int) -> PhotoRow:
    return PhotoRow(
        id=view.id,
        file_name=view.file_name,
        view=at,
        n_truth=rows[0].n_valid,
        cells=tuple(_cell(page, row, answer) for row, answer in zip(rows, view.sides, strict=True)),
        categories=(),
    )


def _cell(page: PixelPage, row: PixelRow, answer: Answer) -> PixelCell:
    name, policy = page.first
    cell = PixelCell(
        status=row.status,
        advice=answer.advice[0].what if answer.advice else "",
        findings=sum(a.level == "bad" for a in answer.advice),
        metric=next(iter(page.names.values())),
        score=row.scores[name][policy] if row.scores else None,
        holes=None if row.hole_share is UNSET else row.hole_share,
    )
    if page.constant is None:
        return cell
    return replace(cell, constant=page.constant(row) if row.has_score else None)
