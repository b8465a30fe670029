"""What a page says first: the verdict, what costs most, the main metrics, and the coverage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from legoworld.comparison.verdict import headline_rows, noun, standing, verdict_sentence
from legoworld.evaluation.stored import Evaluated
from legoworld.pluralize import counted, share
from legoworld.records.comparison import ComparisonRow, Difference, Measured, Pair
from legoworld.records.evaluation_rows import DetectionRow, ScoredDepthRow
from legoworld.records.evaluation_summary import Interval
from legoworld.records.report_summary import (
    Cost,
    CoverageBar,
    CoveragePart,
    FirstScreen,
    ForestRow,
    SideCosts,
    Span,
    Verdict,
)
from legoworld.report.sources import Section

#: How many kinds of errors are named.
_MOST: Final = 4
#: Of each side where there are several.
_MOST_OF_EACH: Final = 3
#: The metrics of the forest plot, as comparisons call them, with the page's names.
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
        forest=tuple(_forest(section)),
        coverage=tuple(_coverage(side) for side in section.sides),
    )


def _verdicts(section: Section) -> Iterator[Verdict]:
    if section.comparison is not None:
        for pair in section.comparison.pairs:
            sentence = verdict_sentence(section.task, pair)
            yield Verdict(sentence=f"{sentence}.", standing=standing(headline_rows(pair)[0]))
        return
    for side in section.sides:
        yield Verdict(sentence=_alone(side), standing="alone")


def _alone(side: Evaluated) -> str:
    """One evaluation in a sentence."""
    coverage = side.summary.coverage
    images = f"{share(coverage.scored, coverage.attempted, 'image', 'images')} scored"
    name = noun(side.task, side.name)
    if side.task == "eth3d":
        value = _depth_span(side, "abs_rel.error_1")
        return f"{name}: AbsRel {_spelt(value)}, {images}."
    counts = side.detection.counts
    value = _detection_span(side, "AP")
    objects = counted(counts.truth_instances, "annotated object", "annotated objects")
    categories = counted(counts.categories_with_truth, "category", "categories")
    return f"{name}: AP {_spelt(value)} over {objects} in {categories}, {images}."


def _spelt(span: Span | None) -> str:
    if span is None or span.value is None:
        return "undefined"
    ends = "" if span.low is None else f" [{span.low:.3f}, {span.high:.3f}]"
    return f"{span.value:.3f}{ends}"


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


def _forest(section: Section) -> Iterator[ForestRow]:
    """The main metrics of every side over all attempted images, and their differences."""
    metrics = _DEPTH if section.task == "eth3d" else _DETECTION
    pairs = section.comparison.pairs if section.comparison else ()
    for metric, name in metrics.items():
        compared = [_row(pair, metric) for pair in pairs]
        sides = [_side_span(side, metric) for side in section.sides]
        if not section.sides and compared and compared[0]:
            others = (_span(row.baseline if row else None) for row in compared)
            sides = [_span(compared[0].scene), *others]
        if all(span is None or span.value is None for span in sides):
            continue
        yield ForestRow(
            name=name,
            better="lower" if metric.startswith("abs_rel") else "higher",
            sides=tuple(sides),
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


def _side_span(side: Evaluated, metric: str) -> Span | None:
    return _depth_span(side, metric) if side.task == "eth3d" else _detection_span(side, metric)


def _detection_span(side: Evaluated, metric: str) -> Span | None:
    summary = side.detection
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


def _depth_span(side: Evaluated, metric: str) -> Span | None:
    summary = side.depth
    name, _, policy = metric.partition(".")
    if policy not in summary.metrics.get(name, {}):
        return None
    coverage = summary.coverage
    over = share(coverage.scored, coverage.attempted, "image", "images")
    return _with_ends(summary.metrics[name][policy], summary.intervals[name][policy], over)


def _with_ends(value: float | None, known: Interval | None, over: str) -> Span:
    low, high = (known.ends if known else None) or (None, None)
    return Span(value=value, low=low, high=high, over=over)


def _coverage(side: Evaluated) -> CoverageBar:
    """Every image once: with a score, scored without a prediction, or failed and why."""
    parts: Counter[tuple[str, str]] = Counter()
    for row in side.rows:
        if isinstance(row, DetectionRow):
            empty = row.scored and row.n_predictions == 0
            status = "scored without predictions" if empty else row.status
            parts["empty" if empty else "scored" if row.scored else "failed", status] += 1
        else:
            parts["scored" if isinstance(row, ScoredDepthRow) else "failed", row.status] += 1
    order = ("scored", "empty", "failed")
    ordered = sorted(parts, key=lambda key: (order.index(key[0]), key[1]))
    return CoverageBar(
        label=side.name,
        attempted=side.summary.coverage.attempted,
        parts=tuple(
            CoveragePart(
                name="scored" if (sort, name) == ("scored", "ok") else name,
                sort=sort,  # type: ignore[arg-type]
                n=parts[sort, name],
            )
            for sort, name in ordered
        ),
    )
