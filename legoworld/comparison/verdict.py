"""A comparison in one sentence: both sides, the difference, its interval, and the denominators."""

from __future__ import annotations

from typing import Final, Literal

from legoworld.comparison.measures import HEADLINE
from legoworld.pluralize import share
from legoworld.records.comparison import ComparisonRow, Difference, Pair
from legoworld.tables.table import Number, line
from legoworld.tasks.registry import find_task

Standing = Literal["better", "worse", "not told apart", "no interval"]
_NAMES: Final = {
    "abs_rel.error_1": "AbsRel",
    "abs_rel.exclude": "AbsRel without holes",
    "delta1.error_1": "delta1",
}


def classify_difference(row: ComparisonRow) -> Standing:
    """Which side the interval of the difference is on."""
    ends = row.difference.ends
    if row.difference.value is None or ends is None:
        return "no interval"
    if ends[0] <= 0 <= ends[1]:
        return "not told apart"
    return "better" if (ends[0] > 0) == (row.better == "higher") else "worse"


def headline_rows(pair: Pair) -> list[ComparisonRow]:
    """The first metrics over the paired images; over all attempted ones where none is paired."""
    rows = [row for row in pair.rows if row.level <= HEADLINE]
    paired = [row for row in rows if row.images == "paired"]
    return paired or [row for row in rows if row.images == "attempted"]


def verdict_sentences(task: str, pair: Pair) -> list[tuple[str, Standing]]:
    """The first headline metric of two methods, with its verdict.

    Over the images of both; where these are not all, over every attempted one, too.
    """
    row, coverage = headline_rows(pair)[0], pair.coverage
    images = share(coverage.paired, coverage.attempted, "image", "images")
    name = _NAMES.get(row.metric, row.metric)
    told: list[tuple[str, Standing]] = [
        (
            f"{noun(task, pair.scene)}: {name} {spelt(row.scene)} against {pair.baseline} "
            f"{spelt(row.baseline)}; difference {spelt(row.difference, signed=True)}, {images} "
            f"paired",
            classify_difference(row),
        )
    ]
    every = _attempted_row(row, pair)
    if every is not None:
        said = (
            f"Over all {coverage.attempted} attempted: {name} {spelt(every.scene)} against "
            f"{spelt(every.baseline)}; difference {spelt(every.difference, signed=True)}"
        )
        told.append((said, classify_difference(every)))
    return [(f"{said}: {_WORDS[standing]}.", standing) for said, standing in told]


def _attempted_row(row: ComparisonRow, pair: Pair) -> ComparisonRow | None:
    """The same metric over all attempted images, where the paired ones are fewer."""
    if row.images != "paired" or pair.coverage.paired == pair.coverage.attempted:
        return None
    same = (r for r in pair.rows if r.metric == row.metric and r.images == "attempted")
    return next(same, None)


def noun(task: str, name: str) -> str:
    """The subject of a sentence: "Scene boxes", or "YOLOX-nano" for what is no scene."""
    known = find_task(task)
    return known.noun if known and name == "scene" else name


def spelt(side: Difference, *, signed: bool = False) -> str:
    """A number with its interval: 0.588 [0.477, 0.708]."""
    value = Number(value=side.value, ends=side.ends, signed=signed, digits=3)
    return "undefined" if side.value is None else line(value)


_WORDS: Final = {
    "better": "better",
    "worse": "worse",
    "not told apart": "not told apart",
    "no interval": "no interval, so no verdict",
}
