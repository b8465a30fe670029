"""A report's first screen and its plots: numbers that the page draws."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import Record

#: How two sides stand: by the interval of their difference.
Standing = Literal["better", "worse", "not told apart", "no interval", "alone"]


class Verdict(Record, frozen=True, kw_only=True):
    """One sentence with its denominators. standing: of the first side named.

    main: it is over the images that both sides answer; otherwise it repeats one over all attempted.
    """

    sentence: str
    main: bool = True
    standing: Standing


class Cost(Record, frozen=True, kw_only=True):
    """Errors of one kind in one category, of one side; or its images without an answer.

    gain: what AP gains where they are mended; others: where the other side's are, of two.
    kind, category: what lists their photos, with the side.
    """

    kind: str
    category: int | None
    n: int
    images: int
    text: str
    gain: float
    others: float | None


class SideCosts(Record, frozen=True, kw_only=True):
    """What costs a side most AP, the most first. n: all its errors."""

    label: str
    n: int
    most: tuple[Cost, ...]


class Span(Record, frozen=True, kw_only=True):
    """A number and the ends of its interval, None where it has none. over: its denominators."""

    value: float | None
    low: float | None
    high: float | None
    over: str


class ForestRow(Record, frozen=True, kw_only=True):
    """A metric: a span of each side, and of the difference to each other side.

    better: which way is better.
    """

    name: str
    better: Literal["higher", "lower"]
    sides: tuple[Span | None, ...]
    differences: tuple[Span | None, ...]


class CoveragePart(Record, frozen=True, kw_only=True):
    """Images of one sort. sort: what its colour says."""

    name: str
    sort: Literal["scored", "empty", "failed"]
    n: int


class CoverageBar(Record, frozen=True, kw_only=True):
    """All attempted images of a side, each in one part."""

    label: str
    attempted: int
    parts: tuple[CoveragePart, ...]


class PrecisionRecall(Record, frozen=True, kw_only=True):
    """Precision at the 101 recall thresholds at IoU 0.5, the mean over categories with truth.

    The mean of `precision` is AP50. low, high: the 2.5th and 97.5th percentile over random orders
    of equally confident predictions, empty where no order is open; draws: how many.
    """

    label: str
    policy: Literal["own scores", "equal confidence"]
    categories: int
    precision: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    draws: int


class IouHistogram(Record, frozen=True, kw_only=True):
    """IoU of predictions with the ground truth of their category that they are about.

    edges: of the bins; tp, low: true positives, and localisation errors, in each.
    """

    label: str
    edges: tuple[float, ...]
    tp: tuple[int, ...]
    low: tuple[int, ...]


class DepthError(Record, frozen=True, kw_only=True):
    """|aligned - truth| / truth by true depth, over the drawn pixels of all scored photos.

    edges_m: of the bins, equal ratios apart; n: pixels in each; low, median, high: the 10th, 50th
    and 90th percentile there, None where a bin is empty.
    """

    label: str
    edges_m: tuple[float, ...]
    n: tuple[int, ...]
    low: tuple[float | None, ...]
    median: tuple[float | None, ...]
    high: tuple[float | None, ...]


class FirstScreen(Record, frozen=True, kw_only=True):
    """What is read before anything else."""

    verdicts: tuple[Verdict, ...]
    costs: tuple[SideCosts, ...]
    forest: tuple[ForestRow, ...]
    coverage: tuple[CoverageBar, ...]


class Plots(Record, frozen=True, kw_only=True):
    """Curves and histograms; empty where a task has none."""

    precision_recall: tuple[PrecisionRecall, ...] = ()
    iou: tuple[IouHistogram, ...] = ()
    depth_error: tuple[DepthError, ...] = ()
