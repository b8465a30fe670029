"""What a page says first: the verdict, what costs most, the main metrics, and the coverage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from legoworld.comparison.verdict import classify_difference, headline_rows, noun, verdict_sentence
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.evaluation_rows import Outcome
from legoworld.records.report_summary import (
    Cost,
    CoverageBar,
    CoveragePart,
    FirstScreen,
    SideCosts,
    Verdict,
)
from legoworld.report.forest import evaluated_sentence, forest_rows
from legoworld.report.sources import Section

#: How many kinds of errors are named.
_MOST: Final = 4
#: Of each side where there are several.
_MOST_OF_EACH: Final = 3
#: A false positive or a missed object of a kind, in words; {0} is the category.
_WORDS: Final = {
    "classification": "{0}: another category in the ground truth",
    "localisation": "{0}: overlaps its object too little",
    "both": "{0}: wrong category and too little overlap",
    "duplicate": "{0}: a second prediction of one object",
    "background": "{0}: nothing annotated there",
    "missed": "{0} missed",
}
#: (error kind, category id) of every error of an image.
Errors = Sequence[tuple[str, int]]


def first_screen(
    section: Section, errors: Sequence[Mapping[int, Errors]], names: Mapping[int, str]
) -> FirstScreen:
    """errors: of each side, by image id; empty for depth."""
    return FirstScreen(
        verdicts=tuple(_verdicts(section)),
        costs=tuple(
            _costs(side.name, of_side, names, _MOST_OF_EACH if len(errors) > 1 else _MOST)
            for side, of_side in zip(section.sides, errors, strict=False)
        ),
        forest=forest_rows(
            section.task, [side.summary for side in section.sides], section.comparison
        ),
        coverage=tuple(_coverage(side) for side in section.sides),
    )


def _verdicts(section: Section) -> Iterator[Verdict]:
    if section.comparison is not None:
        for pair in section.comparison.pairs:
            sentence = verdict_sentence(section.task, pair)
            yield Verdict(
                sentence=f"{sentence}.", standing=classify_difference(headline_rows(pair)[0])
            )
        return
    for side in section.sides:
        sentence = evaluated_sentence(noun(side.task, side.name), side.summary)
        yield Verdict(sentence=sentence, standing="alone")


def _costs(
    label: str, errors: Mapping[int, Errors], names: Mapping[int, str], most_shown: int
) -> SideCosts:
    """Errors by kind and category, the most first."""
    counts: Counter[tuple[str, int]] = Counter()
    images: Counter[tuple[str, int]] = Counter()
    for of_image in errors.values():
        counts.update(of_image)
        images.update(set(of_image))
    ordered = sorted(counts, key=lambda key: (-counts[key], key))
    most = tuple(
        Cost(
            kind=kind,
            category=category,
            name=names[category],
            n=counts[kind, category],
            images=images[kind, category],
            text=_WORDS[kind].format(names[category]),
        )
        for kind, category in ordered[:most_shown]
    )
    return SideCosts(label=label, n=counts.total(), most=most)


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
