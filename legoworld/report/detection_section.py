"""The boxes or masks of a page: a list of photos, a view of each, error counts and curves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Final

from msgspec.structs import replace

from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import plural
from legoworld.records.base import UNSET
from legoworld.records.report_page import (
    DetectionAnswer,
    DetectionCell,
    DetectionPageView,
    PhotoRow,
)
from legoworld.records.report_tables import ErrorCounts, PageSection, Plots
from legoworld.report.advice import detection_advice
from legoworld.report.cohorts import USUAL_CONFIDENCE, cohorts, is_ranked, photo_gains
from legoworld.report.costs import Finding, Findings, Key, side_costs
from legoworld.report.detection_images import DetectionImage, SideImage, detection_images
from legoworld.report.error_kinds import KINDS
from legoworld.report.facts import run_facts, run_tables
from legoworld.report.first_screen import first_screen
from legoworld.report.mended_ap import CAMERA, MendedAp, prediction_errors
from legoworld.report.page_content import PageDocument, Photos
from legoworld.report.photo_order import in_order
from legoworld.report.plots import IouCounts, precision_recall
from legoworld.report.shapes import drawn_predictions, drawn_truths
from legoworld.report.sources import Section
from legoworld.report.tables import category_lines, category_table
from legoworld.report.tie_picture import tie_pictures
from legoworld.report.tried import Shift, common_shift

#: An error of a kind, in words; {0} is the category.
_WORDS: Final = {
    "classification": "{0}: taken for another category",
    "localisation": "{0}: overlaps too little",
    "both": "{0}: wrong category and place",
    "duplicate": "{0}: an object predicted twice",
    "background": "{0}: nothing annotated there",
    "missed": "{0} missed",
    CAMERA[0]: "everything is displaced by the same pixels: the camera",
}


@dataclass(kw_only=True)
class _SideErrors:
    """One side's errors, image by image."""

    mended_ap: MendedAp
    by_image: dict[int, list[tuple[str, int]]] = field(default_factory=dict)
    n_reached: int = 0
    iou: IouCounts = field(default_factory=IouCounts)

    def add(self, image: DetectionImage, side: SideImage, shift: Shift | None) -> None:
        self.by_image[image.image.id] = list(_errors(image, side))
        self.mended_ap.add(image, side, shift)
        self.n_reached += side.errors.truth.count("reached")
        self.iou.add(side)

    def counts(self, label: str) -> ErrorCounts:
        kinds = [[kind for kind, _ in errors] for errors in self.by_image.values()]
        return ErrorCounts(
            label=label,
            counts={k: sum(of_image.count(k) for of_image in kinds) for k in KINDS},
            images={k: sum(k in of_image for of_image in kinds) for k in KINDS},
            reached=self.n_reached,
        )


def detection_section(
    section: Section, draft: PageSection, document: PageDocument, places: Photos
) -> PageSection:
    """A section with its photos; their views go into the document."""
    sides = section.sides
    truth = sides[0].truth_view()
    names = {c.id: c.name for c in truth.categories}
    sizes_wh = {i.id: (i.width, i.height) for i in truth.images}
    places.read([(row.file_name, sizes_wh[row.image_id]) for row in sides[0].rows])
    rows: list[tuple[float, PhotoRow]] = []
    used: set[int] = set()
    errors = [_SideErrors(mended_ap=MendedAp(side=side)) for side in sides]
    ranked = [is_ranked(side) for side in sides]
    gains = photo_gains(sides[0]) if ranked[0] else None
    for image in detection_images(sides):
        shifts = [common_shift(section.task, image, side) for side in image.sides]
        view = _view(section, image, shifts, names, document, places)
        # What costs a ranked first side most AP first; else its lowest quality. Neither truth nor
        # a false prediction last.
        quality = image.sides[0].quality
        row = _row(image, view, ranked, len(document.views))
        worst = quality if gains is None else -gains.get(image.image.id, 0.0)
        rows.append((math.inf if quality is None or worst is None else worst, row))
        document.views.append(view)
        used |= view.categories
        for of_side, side, shifted in zip(errors, image.sides, shifts, strict=True):
            of_side.add(image, side, shifted)
    categories = category_lines(sides)
    return replace(
        draft,
        first=first_screen(section, side_costs([_findings(e.mended_ap, names) for e in errors])),
        ties=tuple(picture for side in sides for picture in tie_pictures(side)),
        categories=tuple(categories),
        category_table=category_table(section.key, sides, categories),
        names={str(i): names[i] for i in sorted(used)},
        errors=tuple(e.counts(s.name) for s, e in zip(sides, errors, strict=True)),
        images=in_order(rows),
        cohorts=cohorts(sides),
        plots=Plots(
            precision_recall=tuple(curve for side in sides for curve in precision_recall(side)),
            iou=tuple(e.iou.histogram(s.name) for s, e in zip(sides, errors, strict=True)),
        ),
    )


def _findings(mended_ap: MendedAp, names: Mapping[int, str]) -> Findings:
    """One side's errors by kind and category, with what mending them gains."""
    costs, side = mended_ap.costs(), mended_ap.side
    attempted = side.summary.coverage.attempted
    found: dict[Key, Finding] = {
        (kind, category): Finding(
            text=_WORDS[kind].format(names.get(category)),
            gain=gain,
            images=mended_ap.images_by_error[kind, category],
            category=None if kind == CAMERA[0] else category,
            kind_filter="" if kind == CAMERA[0] else kind,
        )
        for (kind, category), gain in costs.gain.items()
    }
    n = sum(len(images) for key, images in mended_ap.images_by_error.items() if key != CAMERA)
    return Findings(
        side=side,
        metric="AP",
        over=f"all {plural(attempted, 'image', 'images')}",
        by_error=found,
        n_attempted=attempted,
        n_failed=len(mended_ap.failed_images),
        value=costs.ap,
        value_answered=costs.ap_scored,
        errors=f"; {plural(n, 'error', 'errors')}",
    )


def _errors(image: DetectionImage, side: SideImage) -> Iterator[tuple[str, int]]:
    """The key of every false positive, and of every object that is missed."""
    for key, _, _ in prediction_errors(image, side):
        if key is not None:
            yield key
    for truth, state in zip(image.truths, side.errors.truth, strict=True):
        if state == "missed":
            yield "missed", truth.category_id


def _view(
    section: Section,
    image: DetectionImage,
    shifts: Sequence[Shift | None],
    names: Mapping[int, str],
    document: PageDocument,
    places: Photos,
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
            _answer(section.task, image, side, answer, shifted, names, document)
            for side, answer, shifted in zip(section.sides, image.sides, shifts, strict=True)
        ),
    )


def _answer(
    task: str,
    image: DetectionImage,
    side: StoredEvaluation,
    answer: SideImage,
    shift: Shift | None,
    names: Mapping[int, str],
    document: PageDocument,
) -> DetectionAnswer:
    return DetectionAnswer(
        label=side.name,
        status=answer.run_row.status,
        facts=tuple(run_facts(answer.run_row, answer.scene)),
        tables=tuple(run_tables(answer.run_row)),
        advice=detection_advice(task, image, answer, names, shift, scene=side.is_scene),
        predictions=tuple(drawn_predictions(task, image, answer)),
        truth=answer.errors.truth,
        scene=document.scenes.page_scene(answer.scene, answer.run_row) if side.is_scene else None,
    )


def _row(
    image: DetectionImage, view: DetectionPageView, ranked: Sequence[bool], at: int
) -> PhotoRow:
    cells = []
    for side, drawn, is_sure in zip(image.sides, view.sides, ranked, strict=True):
        errors = sorted(set(_errors(image, side))) if drawn.status == "ok" else ()
        cells.append(
            DetectionCell(
                status=drawn.status,
                quality=side.quality,
                tp=side.row.greedy_50.tp,
                fp=side.row.greedy_50.fp,
                fn=side.n_missed,
                errors={
                    kind: tuple(c for _, c in of) for kind, of in groupby(errors, lambda e: e[0])
                },
                sure=_sure(side) if is_sure else UNSET,
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


def _sure(side: SideImage) -> tuple[int, int]:
    sure = [entry.outcome_50 for entry in side.entries if entry.score >= USUAL_CONFIDENCE]
    return sure.count("tp"), sure.count("fp")
