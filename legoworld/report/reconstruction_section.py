"""The cases of a bench on a page: a list, a view of each, and the leaderboard."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from msgspec.structs import replace

from legoworld.comparison.leaderboard import wide_table
from legoworld.comparison.standings import standings_table, with_standings
from legoworld.errors import LegoWorldError
from legoworld.evaluation.reconstruction.protocol import BenchProtocol, bench_protocol
from legoworld.evaluation.reconstruction.reference import Reference, load_reference
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.files import sha256_of_file
from legoworld.records.base import UNSET
from legoworld.records.bench_results import Leaderboard
from legoworld.records.reconstruction import COMPARED, ReconstructionRow
from legoworld.records.report_page import (
    BenchAnswer,
    BenchCell,
    BenchObject,
    BenchPageView,
    BenchPoints,
    BenchRaster,
    CaseLine,
    ObjectScore,
    PhotoRow,
)
from legoworld.records.report_tables import PageSection
from legoworld.records.run_rows import RunRow
from legoworld.report.mended_cases import Loss, bench_costs, picture_losses, surface_losses
from legoworld.report.page_content import PageDocument, Photos
from legoworld.report.photo_order import in_order
from legoworld.report.reconstruction_advice import bench_advice, bench_facts, check_lines
from legoworld.report.reconstruction_case import (
    SeenSurface,
    differences,
    seen_from_reference,
    seen_surface,
)
from legoworld.report.reconstruction_inputs import BenchInputs, bench_inputs
from legoworld.report.reconstruction_pictures import (
    drawn_objects,
    drawn_points,
    error_picture,
    hit_picture,
)
from legoworld.report.reconstruction_tables import (
    bench_first_screen,
    bench_tables,
    flag_tables,
    leaderboard_table,
    second_card_tables,
)
from legoworld.report.sources import Section
from legoworld.tables.table import Table


@dataclass(frozen=True, kw_only=True)
class _Submission:
    """One side's answer to a case. reason: why there is no picture of its surface, else ""."""

    side: StoredEvaluation
    row: ReconstructionRow
    run_row: RunRow
    inputs: BenchInputs | None
    surface: SeenSurface | None
    reason: str


@dataclass(frozen=True, kw_only=True)
class _Bench:
    """A section's sides with the folders behind them. ids: of the categories, by name.

    pictures: what costs each side's A, as its pictures are made.
    """

    section: Section
    document: PageDocument
    photos: Photos
    inputs: tuple[BenchInputs | str, ...]
    ids: Mapping[str, int]
    pictures: tuple[list[Loss], ...]

    @cached_property
    def protocol(self) -> BenchProtocol:
        """Protocol of the shipped card."""
        return bench_protocol()


def bench_section(
    section: Section, draft: PageSection, document: PageDocument, places: Photos
) -> PageSection:
    """A section with its cases; their views go into the document."""
    sides = section.sides
    inputs = tuple(bench_inputs(side) for side in sides)
    known = next((i for i in inputs if isinstance(i, BenchInputs)), None)
    if known is not None:
        places = Photos(folder=known.dataset.folders.public / "images", document=document)
    names = {o.category for side in sides for r in side.reconstruction_rows for o in r.objects}
    if known is not None:
        cases = known.dataset.cases.values()
        names |= {o.category for case in cases for o in case.truth.scored}
    bench = _Bench(
        section=section,
        document=document,
        photos=places,
        inputs=inputs,
        ids={name: k for k, name in enumerate(sorted(names))},
        pictures=tuple([] for _ in sides),
    )
    places.read([(row.file_name, None) for row in sides[0].rows])
    rows: list[tuple[float, PhotoRow]] = []
    for of_case in zip(*(side.reconstruction_rows for side in sides), strict=True):
        view = _view(bench, of_case)
        line = _line(of_case, view, len(document.views), bench.ids)
        rows.append((_score(of_case[0]), line))
        document.views.append(view)
    tables = bench_tables(section)
    surfaces = [
        [loss for row in side.reconstruction_rows for loss in surface_losses(row)] for side in sides
    ]
    costs = bench_costs(sides, surfaces, bench.pictures, bench.ids)
    by_group = replace(wide_table(tables.board), title="Leaderboard by group")
    return replace(
        draft,
        first=bench_first_screen(section, tables.board, costs),
        overview=(
            leaderboard_table(tables),
            *second_card_tables(tables),
            *_standings(section, tables.board),
            *flag_tables(section),
        ),
        numbers=(by_group, *draft.numbers),
        images=in_order(rows),
        names={str(k): name for name, k in bench.ids.items()},
        bench=tables,
    )


def _standings(section: Section, board: Leaderboard) -> tuple[Table, ...]:
    """Ranks and paired differences, where there are several systems."""
    if len(board.rows) < 2 or any(side.summary.partial for side in section.sides):
        return ()
    return (replace(standings_table(with_standings(board, section.sides)), title="Systems"),)


def _score(row: ReconstructionRow) -> float:
    """S, or R where there is no render."""
    value = row.S if row.S is not None else row.R
    return math.inf if value is None else value


def _view(bench: _Bench, rows: Sequence[ReconstructionRow]) -> BenchPageView:
    first = rows[0]
    photo, said = bench.photos.place(first.file_name, None)
    reference = _reference(bench, first.image_id)
    submissions = [
        _submission(bench, side, row, inputs, reference)
        for side, row, inputs in zip(bench.section.sides, rows, bench.inputs, strict=True)
    ]
    objects: list[BenchObject] = []
    raster: BenchRaster | None = None
    points: list[BenchPoints | None] = [None] * len(submissions)
    size_wh = (1, 1)
    if isinstance(reference, Reference):
        case = next(i for i in bench.inputs if isinstance(i, BenchInputs)).dataset.cases
        objects = drawn_objects(reference, case[first.image_id], bench.ids)
        raster, points = drawn_points(reference, [s.surface for s in submissions])
        size_wh = reference.raster.width, reference.raster.height
    return BenchPageView(
        section=bench.section.key,
        id=first.image_id,
        file_name=first.file_name,
        size_wh=size_wh,
        photo=photo,
        said=said,
        objects=tuple(objects),
        raster=raster,
        sides=tuple(
            _answer(bench, submission, drawn, reference, lost)
            for submission, drawn, lost in zip(submissions, points, bench.pictures, strict=True)
        ),
    )


def _reference(bench: _Bench, image_id: int) -> Reference | str:
    """The reference of a case, or why there is none."""
    said = ""
    for inputs in bench.inputs:
        if isinstance(inputs, str):
            said = said or inputs
            continue
        data = inputs.dataset
        try:
            return load_reference(data.folders, data.cases[image_id], bench.protocol.depth_limit_m)
        except LegoWorldError as error:
            said = error.what
    return said


def _submission(
    bench: _Bench,
    side: StoredEvaluation,
    row: ReconstructionRow,
    inputs: BenchInputs | str,
    reference: Reference | str,
) -> _Submission:
    run_row = side.run_rows[row.image_id]
    surface, reason = None, ""
    if isinstance(inputs, str) or isinstance(reference, str):
        reason = inputs if isinstance(inputs, str) else str(reference)
    elif row.status != COMPARED:
        reason = f"it was not compared: {row.status}"
    else:
        try:
            sampling = side.reconstruction.protocol.reference_sampling
            surface = seen_surface(inputs, reference, run_row, row, bench.protocol, sampling)
        except LegoWorldError as error:
            reason = error.what
    return _Submission(
        side=side,
        row=row,
        run_row=run_row,
        inputs=None if isinstance(inputs, str) else inputs,
        surface=surface,
        reason=reason,
    )


def _answer(
    bench: _Bench,
    of: _Submission,
    points: BenchPoints | None,
    reference: Reference | str,
    losses: list[Loss],
) -> BenchAnswer:
    document, row, run_row = bench.document, of.row, of.run_row
    hit, wrong, why = None, None, of.reason
    render, posed = bench_render(of), None
    if of.surface is not None:
        hit = _add_overlay(document, hit_picture(of.surface))
    if of.surface is not None and of.inputs is not None and isinstance(reference, Reference):
        posed = seen_from_reference(of.inputs, reference, run_row, of.surface, bench.protocol)
    if of.inputs is not None and not isinstance(render, str):
        try:
            delta = bench.protocol.delta
            largest = differences(of.inputs, run_row, row)
            wrong = _add_overlay(document, error_picture(largest, delta))
            if isinstance(reference, Reference):
                losses += picture_losses(row, largest, reference.label, delta)
        except LegoWorldError as error:
            render = why = error.what
    return BenchAnswer(
        label=of.side.name,
        status=row.status,
        facts=tuple(bench_facts(row, run_row)),
        tables=(),
        advice=bench_advice(row, run_row, posed),
        scene=document.scenes.bench_scene(of.side.source(row.image_id), run_row, render),
        objects=tuple(_objects(row)),
        checks=check_lines(row),
        hit_picture=hit,
        error_picture=wrong,
        why_no_picture=why or (render if isinstance(render, str) else ""),
        points=points,
    )


def bench_render(of: _Submission) -> Path | str:
    """The evaluator's render of a submission, or why there is none."""
    if of.inputs is None:
        return of.reason
    if of.run_row.render is UNSET:
        return "the run made no render of it"
    path = of.inputs.run / of.run_row.render.file
    if not path.is_file() or sha256_of_file(path) != of.run_row.render.sha256:
        return "its render is not the one the run wrote"
    return path


def _add_overlay(document: PageDocument, picture: bytes) -> int:
    document.overlays.append(picture)
    return len(document.overlays) - 1


def _objects(row: ReconstructionRow) -> Iterator[ObjectScore]:
    for scored in row.objects:
        yield ObjectScore(
            f1=scored.f1,
            precision=scored.precision,
            recall=scored.recall,
            eligible=scored.eligible,
            n_reference=scored.n_reference,
            n_submitted=scored.n_submitted,
            at={name: found.f1 for name, found in scored.at.items()},
        )


def _line(
    rows: Sequence[ReconstructionRow], view: BenchPageView, at: int, ids: Mapping[str, int]
) -> CaseLine:
    known = {o.c for o in view.objects} | {ids[o.category] for row in rows for o in row.objects}
    cells = []
    for row, drawn in zip(rows, view.sides, strict=True):
        cells.append(
            BenchCell(
                status=row.status,
                advice=drawn.advice[0].what if drawn.advice else "",
                findings=sum(a.level == "bad" for a in drawn.advice),
                valid=row.valid,
                R=row.R,
                A=row.A,
                S=row.S,
                flags=tuple(sorted({flag.kind for flag in row.flags})),
            )
        )
    return CaseLine(
        id=view.id,
        file_name=view.file_name,
        view=at,
        n_truth=max(len(view.objects), *(len(row.objects) for row in rows)),
        cells=tuple(cells),
        categories=tuple(sorted(known)),
        family=rows[0].family,
        tier=rows[0].tier or "",
    )
