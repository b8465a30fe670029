"""Relations on a page: the main metrics, and photos with each question drawn between its things."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, cast

from msgspec.structs import replace

from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import plural
from legoworld.records.relations import RelationsRow, RelationsView
from legoworld.records.report_page import Advice, Answer, PhotoRow, RelationsCell, RelationsPageView
from legoworld.records.report_tables import PageSection
from legoworld.records.track import ShownQuestion
from legoworld.report.advice import failure_advice, sorted_advice
from legoworld.report.costs import Finding, Findings, Key, side_costs
from legoworld.report.facts import run_facts, run_tables
from legoworld.report.family import PageFamily
from legoworld.report.first_screen import first_screen
from legoworld.report.page_content import PageDocument, Photos
from legoworld.report.photo_order import in_order
from legoworld.report.sources import Section

#: Wrong answers that are told of a photo.
_TOLD: Final = 20


def _fill(
    section: Section, draft: PageSection, document: PageDocument, places: Photos
) -> PageSection:
    """A section with its photos, the worst of the first side first."""
    places.read([(row.file_name, None) for row in section.sides[0].rows])
    rows: list[tuple[float, PhotoRow]] = []
    for of_sides in zip(*(side.rows for side in section.sides), strict=True):
        image = cast("tuple[RelationsRow, ...]", of_sides)
        views = [side.image_view(RelationsView, image[0].image_id) for side in section.sides]
        view = _view(section, image, [v.questions if v else () for v in views], document, places,
                     next((v.size_wh for v in views if v and v.size_wh), (640, 480)))  # fmt: skip
        cells = tuple(map(_cell, image, view.sides))
        worst = cells[0].accuracy if cells[0].accuracy is not None else 2.0
        at, n = len(document.views), image[0].n_true
        rows.append(
            (worst, PhotoRow(id=view.id, file_name=view.file_name, view=at, n_truth=n,
                             cells=cells, categories=()))
        )  # fmt: skip
        document.views.append(view)
    first = first_screen(section, side_costs([_findings(side) for side in section.sides]))
    return replace(draft, first=first, images=in_order(rows), names={})


def _findings(side: StoredEvaluation) -> Findings:
    """The wrong and unanswered questions of each relation, by what accuracy gains without them."""
    rows = cast("tuple[RelationsRow, ...]", side.rows)
    answered = [row for row in rows if row.status == "ok"]
    n, right = _accuracy(rows)
    found: dict[Key, Finding] = {}
    for name in sorted({name for row in answered for name in row.by_relation}):
        lost = {r.image_id: s.n - s.score for r in answered if (s := r.by_relation.get(name))}
        asked = sum(row.by_relation[name].n for row in answered if name in row.by_relation)
        wrong = sorted((i for i in lost if lost[i] > 0), key=lambda i: (-lost[i], i))
        if wrong:
            found["relation", name] = Finding(
                text=f"{name}: {sum(lost.values()):.0f} of "
                f"{plural(asked, 'question', 'questions')} not answered right",
                gain=sum(lost.values()) / n,
                images=[image for image in wrong for _ in range(round(lost[image]))],
            )
    n_answered, right_answered = _accuracy(answered)
    return Findings(
        side=side,
        metric="accuracy",
        over=f"all {plural(n, 'question', 'questions')} with a true answer",
        by_error=found,
        n_attempted=len(rows),
        n_failed=sum(row.status != "ok" and row.n_true > 0 for row in rows),
        missing=", each of whose questions counts as wrong",
        value=right / n if n else None,
        value_answered=right_answered / n_answered if n_answered else None,
    )


def _accuracy(rows: Sequence[RelationsRow]) -> tuple[int, float]:
    """Questions that are true or false, or a choice, and the sum of their scores."""
    sums = [row.sums["accuracy"] for row in rows if "accuracy" in row.sums]
    return sum(s.n for s in sums), sum(s.score for s in sums)


def _view(
    section: Section,
    rows: Sequence[RelationsRow],
    questions: Sequence[Sequence[ShownQuestion]],
    document: PageDocument,
    places: Photos,
    size_wh: tuple[int, int],
) -> RelationsPageView:
    photo, said = places.place(rows[0].file_name, None)
    return RelationsPageView(
        section=section.key,
        id=rows[0].image_id,
        file_name=rows[0].file_name,
        size_wh=size_wh,
        photo=photo,
        said=said,
        sides=tuple(
            _answer(side, row, asked, document)
            for side, row, asked in zip(section.sides, rows, questions, strict=True)
        ),
        questions=tuple(map(tuple, questions)),
    )


def _answer(
    side: StoredEvaluation,
    row: RelationsRow,
    questions: Sequence[ShownQuestion],
    document: PageDocument,
) -> Answer:
    run_row, source = side.run_rows[row.image_id], side.source(row.image_id)
    advice = failure_advice(run_row)
    wrong = [q for q in questions if q.score is not None and q.score < 1]
    if not advice:
        advice += [
            Advice(level="bad", what=f"{q.text} {q.answer}, truly {q.truth}") for q in wrong[:_TOLD]
        ]
    advice += [Advice(level="warn", what=warning) for warning in sorted(run_row.warnings)]
    return Answer(
        label=side.name,
        status=row.status,
        facts=tuple(run_facts(run_row, source)),
        tables=tuple(run_tables(run_row)),
        advice=sorted_advice(advice),
        scene=document.scenes.page_scene(source, run_row) if side.is_scene else None,
    )


def _cell(row: RelationsRow, answer: Answer) -> RelationsCell:
    sums = row.sums.get("accuracy")
    return RelationsCell(
        status=row.status,
        advice=answer.advice[0].what if answer.advice else "",
        findings=sum(a.level == "bad" for a in answer.advice),
        accuracy=sums.score / sums.n if sums else None,
        answered=row.n_answered,
    )


PAGE: Final = PageFamily(
    forest={
        "accuracy.answers": "accuracy",
        "count_exact.answers": "counts",
        "mra.answers": "metres",
        "refer_50.answers": "referred boxes",
    },
    fill=_fill,
)
