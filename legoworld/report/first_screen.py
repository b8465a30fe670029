"""What a page says first: the verdict, what costs most, the main metrics, and the coverage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from legoworld.comparison.verdict import noun, verdict_sentences
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.evaluation import Outcome
from legoworld.records.report_tables import (
    CoverageBar,
    CoveragePart,
    FirstScreen,
    SideCosts,
    Verdict,
)
from legoworld.report.forest import evaluated_sentence, forest_rows
from legoworld.report.sources import Section


def first_screen(section: Section, costs: Sequence[SideCosts] = ()) -> FirstScreen:
    """costs: of each side, where the family tells them."""
    return FirstScreen(
        verdicts=tuple(_verdicts(section)),
        costs=tuple(costs),
        forest=forest_rows(
            section.task, [side.summary for side in section.sides], section.comparison
        ),
        coverage=tuple(_coverage(side) for side in section.sides),
    )


def _verdicts(section: Section) -> Iterator[Verdict]:
    if section.comparison is not None:
        for pair in section.comparison.pairs:
            for at, (sentence, standing) in enumerate(verdict_sentences(section.task, pair)):
                yield Verdict(sentence=sentence, main=at == 0, standing=standing)
        return
    for side in section.sides:
        sentence = evaluated_sentence(noun(side.task, side.name), side.summary)
        yield Verdict(sentence=sentence, standing="alone")


def _coverage(side: StoredEvaluation) -> CoverageBar:
    """Every image once: with a score, scored without a prediction, or failed and why."""
    parts: Counter[Outcome] = Counter()
    for row in side.rows:
        parts[row.outcome] += 1
    order = ("scored", "empty", "failed")
    ordered = sorted(parts, key=lambda key: (order.index(key.sort), key.words))
    return CoverageBar(
        label=side.name,
        attempted=side.summary.coverage.attempted,
        parts=tuple(
            CoveragePart(
                name="scored" if part == ("scored", "ok") else part.words,
                sort=part.sort,
                n=parts[part],
            )
            for part in ordered
        ),
    )
