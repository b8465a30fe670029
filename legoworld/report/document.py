"""Evaluations to what the page holds: tables, a list of photos, and a view of each photo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from msgspec.structs import replace

from legoworld.records.base import UNSET
from legoworld.records.evaluation_rows import DepthRow, ScoredDepthRow
from legoworld.records.report_page import (
    Answer,
    DepthCell,
    DepthPageView,
    DetectionAnswer,
    DetectionCell,
    DetectionPageView,
    PhotoRow,
)
from legoworld.records.report_tables import ErrorCounts, PageSection, SideHead, SideNotes
from legoworld.report.advice import detection_advice
from legoworld.report.depth_images import DepthImage, depth_advice, depth_images
from legoworld.report.detection_images import DetectionImage, detection_images
from legoworld.report.error_kinds import KINDS
from legoworld.report.facts import run_facts, run_tables
from legoworld.report.photos import page_photo
from legoworld.report.provenance import compare_command, provenance
from legoworld.report.shapes import drawn_predictions, drawn_truths
from legoworld.report.sources import Section
from legoworld.report.tables import (
    category_rows,
    comparison_tables,
    coverage_notes,
    coverage_rows,
    depth_rows,
    headline_rows,
    score_free_rows,
)
from legoworld.report.tie_picture import tie_pictures
from legoworld.workers.processors import usable_cores

_TITLES = {"coco": "COCO boxes", "coco-masks": "COCO masks", "lvis": "LVIS masks", "eth3d": "Depth"}


@dataclass(kw_only=True)
class PageDocument:
    """Everything a page shows. views: of every photo of every section; photos: each file once.

    A view's "photo" is a position in photos, or None with "said" saying why.
    """

    sections: list[PageSection] = field(default_factory=list)
    views: list[DetectionPageView | DepthPageView] = field(default_factory=list)
    photos: list[bytes] = field(default_factory=list)


@dataclass(kw_only=True)
class _Photos:
    """Photos by file name and size: sections over the same photos share them."""

    folder: Path | None
    document: PageDocument
    known: dict[tuple[str, tuple[int, int] | None], tuple[int | None, str]] = field(
        default_factory=dict
    )

    def read(self, wanted: Sequence[tuple[str, tuple[int, int] | None]]) -> None:
        """Read photos, several at a time; the page holds them in the order wanted."""
        new = [key for key in dict.fromkeys(wanted) if key not in self.known]
        with ThreadPoolExecutor(usable_cores()) as pool:
            found = pool.map(lambda key: page_photo(self.folder, *key), new)
            for key, photo in zip(new, found, strict=True):
                position = None
                if photo.webp is not None:
                    position = len(self.document.photos)
                    self.document.photos.append(photo.webp)
                self.known[key] = (position, photo.said)

    def place(self, file_name: str, size_wh: tuple[int, int] | None) -> tuple[int | None, str]:
        """Where the page holds a photo that was read, or None and why it does not."""
        return self.known[file_name, size_wh]


def page_document(sections: Sequence[Section], photos: Path | None) -> PageDocument:
    """The whole page as values. photos: the folder they are looked up in, None for none."""
    document = PageDocument()
    places = _Photos(folder=photos, document=document)
    for section in sections:
        made = _section_tables(section)
        if section.sides:
            fill = _depth if section.task == "eth3d" else _detections
            made = fill(section, made, document, places)
        document.sections.append(made)
    return document


def _section_tables(section: Section) -> PageSection:
    sides = section.sides
    made = PageSection(
        key=section.key,
        task=section.task,
        title=_TITLES[section.task],
        sides=tuple(
            SideHead(label=s.name, scene=s.is_scene, used_truth=bool(s.used_truth)) for s in sides
        ),
        specialist=any(not s.is_scene for s in sides),
        comparison=section.comparison,
        pairs=tuple(comparison_tables(section.comparison)) if section.comparison else (),
        compared=compare_command(section.comparison, sides) if section.comparison else None,
    )
    if not sides:
        return made
    return replace(
        made,
        evaluators=tuple(s.summary.evaluator for s in sides),
        partial=tuple(s.name for s in sides if s.summary.partial),
        coverage=tuple(coverage_rows(sides)),
        notes=tuple(SideNotes(label=s.name, lines=tuple(coverage_notes(s))) for s in sides),
        provenance=tuple(provenance(s) for s in sides),
        attempted=sides[0].summary.coverage.attempted,
    )


def _detections(
    section: Section, made: PageSection, document: PageDocument, places: _Photos
) -> PageSection:
    sides = section.sides
    truth = sides[0].truth_view()
    names = {c.id: c.name for c in truth.categories}
    sizes_wh = {i.id: (i.width, i.height) for i in truth.images}
    places.read([(row.file_name, sizes_wh[row.image_id]) for row in sides[0].rows])
    rows: list[tuple[float, PhotoRow]] = []
    used: set[int] = set()
    errors = [dict.fromkeys(KINDS, 0) for _ in sides]
    images_with = [dict.fromkeys(KINDS, 0) for _ in sides]
    reached = [0] * len(sides)
    for image in detection_images(sides):
        view = _detection_view(section, image, names, places)
        # Lowest quality of the first side first; neither truth nor a false prediction last.
        quality = image.sides[0].quality
        row = _detection_row(image, view, len(document.views))
        rows.append((math.inf if quality is None else quality, row))
        document.views.append(view)
        used |= view.categories
        for k, side in enumerate(image.sides):
            reached[k] += side.errors.truth.count("reached")
            for kind, n in side.errors.counts().items():
                errors[k][kind] += n
                images_with[k][kind] += bool(n)
    return replace(
        made,
        head=tuple(headline_rows(sides)),
        score_free=tuple(score_free_rows(sides)),
        ties=tuple(picture for side in sides for picture in tie_pictures(side)),
        categories=tuple(category_rows(sides)),
        names={str(i): names[i] for i in sorted(used)},
        errors=tuple(
            ErrorCounts(label=s.name, counts=c, images=w, reached=r)
            for s, c, w, r in zip(sides, errors, images_with, reached, strict=True)
        ),
        images=_in_order(rows),
    )


def _in_order(rows: Sequence[tuple[float, PhotoRow]]) -> tuple[PhotoRow, ...]:
    """By the number beside each, then by id."""
    return tuple(row for _, row in sorted(rows, key=lambda one: (one[0], one[1].id)))


def _detection_view(
    section: Section, image: DetectionImage, names: Mapping[int, str], places: _Photos
) -> DetectionPageView:
    size_wh = image.image.width, image.image.height
    file_name = image.sides[0].row.file_name
    photo, said = places.place(file_name, size_wh)
    return DetectionPageView(
        section=section.key,
        id=image.image.id,
        file_name=file_name,
        size_wh=size_wh,
        photo=photo,
        said=said,
        truths=tuple(drawn_truths(section.task, image)),
        sides=tuple(
            DetectionAnswer(
                label=side.name,
                status=answer.run_row["status"],
                facts=tuple(run_facts(answer.run_row, answer.scene)),
                tables=tuple(run_tables(answer.run_row)),
                advice=detection_advice(section.task, image, answer, names, scene=side.is_scene),
                predictions=tuple(drawn_predictions(section.task, image, answer)),
                truth=answer.errors.truth,
            )
            for side, answer in zip(section.sides, image.sides, strict=True)
        ),
    )


def _detection_row(image: DetectionImage, view: DetectionPageView, at: int) -> PhotoRow:
    cells = []
    for side, drawn in zip(image.sides, view.sides, strict=True):
        counts = side.errors.counts()
        cells.append(
            DetectionCell(
                status=drawn.status,
                quality=side.quality,
                tp=side.row.greedy_50.tp,
                fp=side.row.greedy_50.fp,
                unfound=side.unfound,
                kinds=tuple(k for k in KINDS if counts[k]),
                advice=drawn.advice[0].what if drawn.advice else "",
                findings=sum(a.level == "bad" for a in drawn.advice),
            )
        )
    return PhotoRow(
        id=view.id,
        file_name=view.file_name,
        view=at,
        n_truth=image.sides[0].row.n_truth,
        cells=tuple(cells),
        categories=tuple(sorted(view.categories)),
    )


def _depth(
    section: Section, made: PageSection, document: PageDocument, places: _Photos
) -> PageSection:
    rows: list[tuple[float, PhotoRow]] = []
    places.read([(row.file_name, None) for row in section.sides[0].rows])
    for image in depth_images(section.sides):
        view = _depth_view(section, image, places)
        # Without a score of the first side first, then its largest error.
        first = image.rows[0]
        error = math.inf
        if isinstance(first, ScoredDepthRow):
            error = first.metrics["abs_rel"]["error_1"]
        rows.append((-error, _depth_row(image, view, len(document.views))))
        document.views.append(view)
    return replace(made, head=tuple(depth_rows(section.sides)), images=_in_order(rows), names={})


def _depth_view(section: Section, image: DepthImage, places: _Photos) -> DepthPageView:
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
            )
            for side, row, run_row, scene in zip(
                section.sides, image.rows, image.run_rows, image.scenes, strict=True
            )
        ),
    )


def _fit_facts(row: DepthRow) -> list[tuple[str, str]]:
    """How the depth was aligned and what it scored, as text."""
    found = [("valid truth", f"{row.n_valid} px of {row.truth_wh[0]}x{row.truth_wh[1]}")]
    if not isinstance(row, ScoredDepthRow):
        return found
    found.append(("fit", f"1/z = {row.s:.6g} x + {row.t:.6g}, x in {row.space}"))
    found.append(("holes", f"{row.hole_share:.2%} of the valid truth"))
    for metric, values in row.metrics.items():
        text = ", ".join(f"{policy} {value:.4f}" for policy, value in values.items())
        found.append((metric, text))
    return found


def _depth_row(image: DepthImage, view: DepthPageView, at: int) -> PhotoRow:
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
