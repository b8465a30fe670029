"""The main metrics of evaluations and comparisons, as a forest plot has them; one as a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from legoworld.pluralize import counted, share
from legoworld.records.comparison import Comparison, ComparisonRow, Difference, Measured, Pair
from legoworld.records.evaluation_summary import DepthSummary, DetectionSummary, Interval
from legoworld.records.reconstruction_summary import ReconstructionSummary
from legoworld.records.report_summary import ForestRow, Span

#: The metrics, as comparisons call them, with the page's names.
_DETECTION: Final = {
    "AP": "AP",
    "AP50": "AP50",
    "AP75": "AP75",
    "APs": "AP small",
    "APm": "AP medium",
    "APl": "AP large",
    "equal_confidence.AP": "AP, equal confidence",
    "class_aware.miou_gt_micro": "mean IoU per object",
    "class_aware.recall_50": "recall at IoU 0.5",
    "class_aware.precision_50": "precision at IoU 0.5",
}
_DEPTH: Final = {
    "abs_rel.error_1": "AbsRel",
    "abs_rel.exclude": "AbsRel, holes left out",
    "delta1.error_1": "delta1",
    "delta2.error_1": "delta2",
    "delta3.error_1": "delta3",
}

#: The bench's score and the three it is the product of.
_BENCH: Final = {"S": "S", "V": "V", "R": "R", "A": "A"}
_METRICS: Final = {"eth3d": _DEPTH, "bench": _BENCH}

AnySummary = DetectionSummary | DepthSummary | ReconstructionSummary


def forest_rows(
    task: str, sides: Sequence[AnySummary], comparison: Comparison | None
) -> tuple[ForestRow, ...]:
    """Every side over all attempted images, and the differences of a comparison.

    sides: empty for a comparison alone, whose own numbers are taken then.
    """
    return tuple(_rows(task, sides, comparison))


def evaluated_sentence(name: str, summary: AnySummary) -> str:
    """One evaluation's first metric with its denominators, as a sentence."""
    coverage = summary.coverage
    images = f"{share(coverage.scored, coverage.attempted, 'image', 'images')} scored"
    if isinstance(summary, DepthSummary):
        return f"{name}: AbsRel {_spelt(_depth_span(summary, 'abs_rel.error_1'))}, {images}."
    if isinstance(summary, ReconstructionSummary):
        valid = share(summary.coverage.valid, coverage.attempted, "case", "cases")
        return f"{name}: S {_spelt(_bench_span(summary, 'S'))}, {valid} valid."
    counts = summary.counts
    objects = counted(counts.truth_instances, "annotated object", "annotated objects")
    categories = counted(counts.categories_with_truth, "category", "categories")
    value = _spelt(_detection_span(summary, "AP"))
    return f"{name}: AP {value} over {objects} in {categories}, {images}."


def _spelt(span: Span | None) -> str:
    if span is None or span.value is None:
        return "undefined"
    ends = "" if span.low is None else f" [{span.low:.3f}, {span.high:.3f}]"
    return f"{span.value:.3f}{ends}"


def _rows(
    task: str, sides: Sequence[AnySummary], comparison: Comparison | None
) -> Iterator[ForestRow]:
    pairs = comparison.pairs if comparison else ()
    for metric, name in _METRICS.get(task, _DETECTION).items():
        compared = [_row(pair, metric) for pair in pairs]
        spans = [_side_span(side, metric) for side in sides]
        if not sides and compared and compared[0]:
            others = (_span(row.baseline if row else None) for row in compared)
            spans = [_span(compared[0].scene), *others]
        if all(span is None or span.value is None for span in spans):
            continue
        yield ForestRow(
            name=name,
            better="lower" if metric.startswith("abs_rel") else "higher",
            sides=tuple(spans),
            differences=tuple(_span(row.difference if row else None) for row in compared),
        )


def _row(pair: Pair, metric: str) -> ComparisonRow | None:
    """A metric's row over all attempted images, or over those of both sides."""
    for images in ("attempted", "scored", "paired"):
        for row in pair.rows:
            if row.metric == metric and row.images == images:
                return row
    return None


def _span(side: Difference | None) -> Span | None:
    if side is None:
        return None
    low, high = side.ends or (None, None)
    over = ""
    if isinstance(side, Measured):
        over = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in sorted(side.over.items()))
    return Span(value=side.value, low=low, high=high, over=over)


def _side_span(side: AnySummary, metric: str) -> Span | None:
    if isinstance(side, DepthSummary):
        return _depth_span(side, metric)
    if isinstance(side, ReconstructionSummary):
        return _bench_span(side, metric)
    return _detection_span(side, metric)


def _bench_span(summary: ReconstructionSummary, metric: str) -> Span | None:
    mean = summary.metrics.get(metric)
    if mean is None:
        return None
    return _with_ends(mean.value, mean.interval, f"{mean.n} {mean.over}")


def _detection_span(summary: DetectionSummary, metric: str) -> Span | None:
    kind, _, name = metric.rpartition(".")
    counts = summary.counts
    over = (
        f"{counted(summary.coverage.attempted, 'image', 'images')}, "
        f"{counted(counts.truth_instances, 'object', 'objects')}"
    )
    if kind == "equal_confidence":
        value = summary.equal_confidence.metrics[name]
        known = summary.intervals.get(name) if summary.equal_confidence.already_equal else None
    elif kind == "class_aware":
        value = summary.matched.class_aware.values()[name]
        known = summary.intervals.get(metric)
        if name == "precision_50":
            over = counted(counts.predictions, "prediction", "predictions")
    else:
        value, known = summary.metrics.get(name), summary.intervals.get(name)
    return _with_ends(value, known, over)


def _depth_span(summary: DepthSummary, metric: str) -> Span | None:
    name, _, policy = metric.partition(".")
    if policy not in summary.metrics.get(name, {}):
        return None
    coverage = summary.coverage
    over = share(coverage.scored, coverage.attempted, "image", "images")
    return _with_ends(summary.metrics[name][policy], summary.intervals[name][policy], over)


def _with_ends(value: float | None, known: Interval | None, over: str) -> Span:
    low, high = (known.ends if known else None) or (None, None)
    return Span(value=value, low=low, high=high, over=over)
