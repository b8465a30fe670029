"""Label maps on a page: ground truth, answers and where they agree, photo by photo."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple, cast

import numpy as np
from msgspec.structs import replace

from legoworld.evaluation.label_maps.family import F64, MapFamily, present_categories, total_sums
from legoworld.evaluation.label_maps.png import encode_webp, view_picture
from legoworld.evaluation.panoptic.family import MAPS as SEGMENTS
from legoworld.evaluation.semantic.family import MAPS as CLASSES
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import plural
from legoworld.readouts.label_maps import picture_categories
from legoworld.readouts.pictures import Rgb
from legoworld.records.base import number
from legoworld.records.label_maps import LabelMapRow, LabelMapSummary, LabelMapView
from legoworld.records.report_page import (
    Advice,
    Answer,
    LabelMapCell,
    LabelMapPageView,
    MapPictures,
    PhotoRow,
)
from legoworld.records.report_tables import PageSection
from legoworld.report.advice import failure_advice, sorted_advice
from legoworld.report.costs import Finding, Findings, Key, side_costs
from legoworld.report.facts import run_facts, run_tables
from legoworld.report.family import PageFamily
from legoworld.report.first_screen import first_screen
from legoworld.report.page_content import PageDocument, Photos
from legoworld.report.photo_order import in_order
from legoworld.report.sources import Section


class _Mend(NamedTuple):
    """A kind of error of a category, of whose sums `MapFamily.values` makes the metrics.

    counts_without: (4,) without it; words: of the error, after the category's name.
    """

    counts_without: Callable[[Any], Sequence[float]]
    words: Callable[[Any], str]


#: A category that fewer of another's wrong pixels are is not named.
_MOSTLY: Final = 0.5


def _share(part: float, whole: float) -> str:
    return f"{1 - part / max(whole, 1):.0%}"


#: Drawn pixels by the categories of truth and answer, where they differ; -1 for none.
_Confusions = Counter[tuple[int, int]]

#: Sums of IoU, TP, FP, FN: a segment that is missed is found whole, a false one is not there.
_OF_SEGMENTS: Final = {
    "missed": _Mend(
        lambda s: (s[0] + s[3], s[1] + s[3], s[2], 0.0),
        lambda s: f"{s[3]:.0f} of {plural(round(s[1] + s[3]), 'segment', 'segments')} missed",
    ),
    "false": _Mend(
        lambda s: (s[0], s[1], 0.0, s[3]),
        lambda s: f"{plural(round(s[2]), 'segment', 'segments')} where no such one is",
    ),
    "loose": _Mend(
        lambda s: (s[1], s[1], s[2], s[3]),
        lambda s: f"mean IoU {s[0] / max(s[1], 1):.2f} of those found",
    ),
}
#: Pixels of hits, truth and answers: missed ones are hits and taken from no other class.
_OF_CLASSES: Final = {
    "missed": _Mend(
        lambda s: (s[0], s[2], s[2], s[3] + s[2] - s[1]),
        lambda s: f"{_share(s[1], s[2])} of its pixels missed",
    ),
    "false": _Mend(
        lambda s: (s[0], s[1], s[2], s[1]),
        lambda s: f"{_share(s[1], s[3])} of its answered pixels are something else",
    ),
}


@dataclass(frozen=True, kw_only=True)
class _Page:
    """A section that is filled. confusions: of every side."""

    family: MapFamily
    section: Section
    document: PageDocument
    places: Photos
    confusions: tuple[_Confusions, ...]


def _findings(
    family: MapFamily, mends: Mapping[str, _Mend], side: StoredEvaluation, confusions: _Confusions
) -> Findings:
    """The errors of each category, by what PQ or mIoU gains without them."""
    rows, metric = cast("tuple[LabelMapRow, ...]", side.rows), family.metrics[0]
    answered = [row for row in rows if row.has_score]
    known = {category.id: category for category in _summary(side).categories}

    def value(sums: F64, ids: Sequence[int]) -> float:
        things = np.array([known[category].isthing for category in ids], bool)
        return float(family.values(sums, things)[metric])

    ids = present_categories(rows)
    sums, of_answered = total_sums(rows, ids), total_sums(answered, ids)
    present = {row.image_id: (present_categories([row]), row) for row in answered}
    own = {
        image: dict(zip(mine, total_sums([row], mine).tolist(), strict=True))
        for image, (mine, row) in present.items()
    }
    found: dict[Key, Finding] = {}
    before = value(sums, ids)
    for k, category in enumerate(ids):
        for kind, mend in mends.items():
            change = np.array(mend.counts_without(of_answered[k])) - of_answered[k]
            if not change.any():
                continue
            after = sums.copy()
            after[k] += change
            text = f"{known[category].name}: {mend.words(of_answered[k])}"
            share, other = _taken_for(confusions, category)
            if kind == "missed" and share >= _MOSTLY:
                text += f"; {share:.0%} of its wrong pixels are {known[other].name}"
            found[kind, category] = Finding(
                text=text,
                gain=value(after, ids) - before,
                images=[
                    image
                    for image, of in own.items()
                    if category in of and [*mend.counts_without(of[category])] != of[category]
                ],
                category=category,
            )
    there = present_categories(answered)
    return Findings(
        side=side,
        metric=metric,
        over=f"all {plural(len(rows), 'image', 'images')} attempted",
        by_error=found,
        n_attempted=len(rows),
        n_failed=sum(not row.has_score for row in rows),
        missing=", all of whose truth is missed",
        value=number(before),
        value_answered=number(value(total_sums(answered, there), there)) if answered else None,
    )


def _fill(
    family: MapFamily,
    mends: Mapping[str, _Mend],
    section: Section,
    draft: PageSection,
    document: PageDocument,
    places: Photos,
) -> PageSection:
    confusions = tuple(_Confusions() for _ in section.sides)
    page = _Page(
        family=family, section=section, document=document, places=places, confusions=confusions
    )
    places.read([(row.file_name, None) for row in section.sides[0].rows])
    rows: list[tuple[float, PhotoRow]] = []
    for of_sides in zip(*(side.rows for side in section.sides), strict=True):
        image = cast("tuple[LabelMapRow, ...]", of_sides)
        cells = tuple(map(partial(_cell, page), section.sides, image))
        first = cells[0].quality
        photo = PhotoRow(
            id=image[0].image_id,
            file_name=image[0].file_name,
            view=len(document.views),
            n_truth=image[0].n_truth,
            cells=cells,
            categories=tuple(present_categories(image)),
        )
        rows.append((-1.0 if first is None else first, photo))
        document.views.append(_view(page, image))
    names = {str(c.id): c.name for s in section.sides for c in _summary(s).categories}
    sides = zip(section.sides, confusions, strict=True)
    costs = side_costs([_findings(family, mends, *side) for side in sides])
    screen = first_screen(section, costs)
    return replace(draft, first=screen, images=in_order(rows), names=names)


def _view(page: _Page, rows: Sequence[LabelMapRow]) -> LabelMapPageView:
    sides = page.section.sides
    photo, said = page.places.place(rows[0].file_name, None)
    stored = [side.image_view(LabelMapView, rows[0].image_id) for side in sides]
    views = [view for view in stored if view is not None]  # every image has one
    truth, answers = view_picture(views[0].truth), [view_picture(view.answer) for view in views]
    for confusions, side, row, answer in zip(page.confusions, sides, rows, answers, strict=True):
        if row.has_score:
            confusions.update(_confusions(truth, answer, [c.id for c in _summary(side).categories]))
    return LabelMapPageView(
        section=page.section.key,
        id=rows[0].image_id,
        file_name=rows[0].file_name,
        size_wh=views[0].size_wh,
        photo=photo,
        said=said,
        sides=tuple(map(partial(_answer, page), sides, rows)),
        maps=MapPictures(
            truth=_add_overlay(page, truth),
            answers=tuple(_add_overlay(page, answer) for answer in answers),
            agreements=tuple(_add_overlay(page, view_picture(view.agreement)) for view in views),
        ),
    )


def _confusions(truth: Rgb, answer: Rgb, ids: Sequence[int]) -> _Confusions:
    """Of one image, both pictures (H, W, 3)."""
    of, given = picture_categories(truth, ids), picture_categories(answer, ids)
    wrong = (of >= 0) & (given > -2) & (of != given)
    pairs, n = np.unique(np.stack([of[wrong], given[wrong]]), axis=1, return_counts=True)
    return _Confusions(dict(zip(zip(*pairs.tolist(), strict=True), n.tolist(), strict=True)))


def _taken_for(confusions: _Confusions, category: int) -> tuple[float, int]:
    """The other category that most of one's wrong pixels are answered as, and their share."""
    wrong = {given: n for (of, given), n in confusions.items() if of == category}
    other = max((given for given in wrong if given >= 0), key=lambda c: (wrong[c], -c), default=-1)
    return (wrong[other] / sum(wrong.values()), other) if other >= 0 else (0.0, -1)


def _add_overlay(page: _Page, picture: Rgb) -> int:
    """The place of a picture among the page's."""
    page.document.overlays.append(encode_webp(picture))
    return len(page.document.overlays) - 1


def _answer(page: _Page, side: StoredEvaluation, row: LabelMapRow) -> Answer:
    run_row, source = side.run_rows[row.image_id], side.source(row.image_id)
    advice = failure_advice(run_row)
    if not row.has_score and not advice:
        advice.append(Advice(level="bad", what=f"not scored ({row.status}): {row.reason}"))
    advice += [Advice(level="warn", what=str(text)) for text in sorted(run_row.warnings)]
    values = _values(page.family, side, row)
    return Answer(
        label=side.name,
        status=row.status,
        facts=(
            *run_facts(run_row, source),
            *((name, "-" if value is None else f"{value:.4f}") for name, value in values.items()),
        ),
        tables=tuple(run_tables(run_row)),
        advice=tuple(sorted_advice(advice)),
        scene=page.document.scenes.page_scene(source, run_row) if side.is_scene else None,
    )


def _cell(page: _Page, side: StoredEvaluation, row: LabelMapRow) -> LabelMapCell:
    sums = total_sums([row], present_categories([row]))[:, 1:].sum(axis=0).astype(int).tolist()
    return LabelMapCell(
        metric=page.family.metrics[0],
        status=row.status,
        advice=row.reason or "",
        findings=int(not row.has_score),
        quality=_values(page.family, side, row)[page.family.metrics[0]] if row.has_score else None,
        counts=tuple(sums),
    )


def _values(family: MapFamily, side: StoredEvaluation, row: LabelMapRow) -> dict[str, float | None]:
    """The metrics of one photo alone."""
    ids = present_categories([row])
    known = {category.id: category.isthing for category in _summary(side).categories}
    things = np.array([known[number] for number in ids], bool)
    found = family.values(total_sums([row], ids), things)
    return {name: number(float(value)) for name, value in found.items()}


def _summary(side: StoredEvaluation) -> LabelMapSummary:
    return cast("LabelMapSummary", side.summary)


def _page(family: MapFamily, mends: Mapping[str, _Mend]) -> PageFamily:
    forest = {name: name for name in family.metrics}
    return PageFamily(forest=forest, fill=partial(_fill, family, mends))


PANOPTIC: Final = _page(SEGMENTS, _OF_SEGMENTS)
SEMANTIC: Final = _page(CLASSES, _OF_CLASSES)
