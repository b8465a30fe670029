"""A detection evaluation as text: the evaluator's own lines, then ours with counts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from legoworld.evaluation.detection.amodal_sums import amodal_part, short_amodal
from legoworld.evaluation.detection.protocols import DetectionProtocol, Metric, detection_protocol
from legoworld.evaluation.metrics import (
    MetricPart,
    MetricRow,
    bounds,
    describe_evaluator,
    first_few,
    fraction,
    image_counts,
    number_cell,
)
from legoworld.pluralize import plural
from legoworld.records.detection import DetectionSummary, Matched, SpaceErrors
from legoworld.tables.table import Number

_SHOWN = ("AP25", "AP50", "AP75")
_TITLES = {"AP": "Average Precision", "AR": "Average Recall"}


def official_lines(protocol: DetectionProtocol, official: Sequence[float]) -> list[str]:
    """The 12 or 13 lines as pycocotools and lvis word them (a test holds them to it)."""
    grid = protocol.grid
    spread = f"{grid.iou[0]:.2f}:{grid.iou[-1]:.2f}"
    word = _lvis_line if protocol.federated else partial(_coco_line, spread=spread)
    return [word(m, v) for m, v in zip(protocol.metrics, official, strict=True)]


def short_detections(summary: DetectionSummary) -> str:
    """AP with its interval and denominators, tie orders, recall at IoU 0.5, warnings."""
    metrics, counts = summary.metrics, summary.counts
    over = (
        f"{plural(counts.categories_with_truth, 'category', 'categories')}, "
        f"{plural(counts.truth_instances, 'annotation', 'annotations')}"
    )
    lines = [
        f"{describe_evaluator(summary)}, {summary.iou_type}: {image_counts(summary.coverage)}",
        f"AP {fraction(metrics['AP'])}{bounds(summary.intervals.get('AP'))}, "
        + ", ".join(f"{m} {fraction(metrics[m])}" for m in _SHOWN if m in metrics)
        + f" over {over}",
    ]
    ties = summary.ties
    if ties.n_tied:
        lines.append(
            f"AP over {plural(ties.draws, 'tie order', 'tie orders')}: "
            f"{fraction(ties.expected)}, between {fraction(ties.worst)} and {fraction(ties.best)}"
        )
    matched = summary.matched.class_aware
    lines.append(
        f"at IoU 0.5: recall {fraction(matched.recall_50)} of "
        f"{plural(matched.n_gt, 'annotation', 'annotations')}, "
        f"precision {fraction(matched.precision_50)} of "
        f"{plural(matched.n_dt, 'prediction', 'predictions')}; mean IoU "
        f"{fraction(matched.miou_gt_micro)}"
    )
    lines += short_amodal(summary)
    if summary.in_space:
        lines.append(_space_line(summary.in_space))
    if summary.partial:
        lines.append("partial run: only some images of its track were attempted")
    warnings = [f"warning: {text}" for text in summary.warnings]
    return "\n".join([*lines, *first_few(warnings, "warning", "warnings")])


def _space_line(errors: SpaceErrors) -> str:
    if errors.center_m is None or errors.yaw_mod_90_deg is None:
        return "no pair of boxes overlaps"
    return (
        f"medians over {plural(errors.pairs, 'pair', 'pairs')} that overlap: centres "
        f"{errors.center_m:.3g} m apart, {fraction(errors.volume_ratio)} of the true volume, "
        f"yaw off by {errors.yaw_mod_90_deg:.1f} degrees modulo 90"
    )


def evaluator_lines(summary: DetectionSummary) -> str:
    """The evaluator, and its numbers as it words them."""
    lines = official_lines(detection_protocol(summary.task), summary.official)
    title = f"{describe_evaluator(summary)}, {summary.iou_type}, {image_counts(summary.coverage)}"
    return "\n\n".join([title, "\n".join(lines)])


def _coco_line(metric: Metric, value: float, spread: str = "0.50:0.95") -> str:
    iou = f"{metric.iou:0.2f}" if metric.iou else spread
    cap = metric.max_rank or 100
    return (
        f" {_TITLES[metric.kind]:<18} ({metric.kind}) @[ IoU={iou:<9} | area={metric.area:>6s} "
        f"| maxDets={cap:>3d} ] = {value:0.3f}"
    )


def _lvis_line(metric: Metric, value: float) -> str:
    """lvis shortens the area to its first letter and names the frequency group."""
    iou = f"{metric.iou:0.2f}" if metric.iou else "0.50:0.95"
    area = "all" if metric.area == "all" else metric.area[0]
    return (
        f" {_TITLES[metric.kind]:<18} ({metric.kind}) @[ IoU={iou:<9} | area={area:>6s} "
        f"| maxDets={300:>3d} catIds={metric.frequency or 'all':>3s}] = {value:0.3f}"
    )


def detection_metrics(summary: DetectionSummary) -> list[MetricPart]:
    """Every number with its interval and denominators: the evaluator's, tie orders, score-free."""
    return [
        MetricPart(
            title="Every metric",
            rows=[*_official_rows(summary), *_tie_rows(summary)],
            note="A missing, failed or refused scene is an image without detections: it stays in "
            "every denominator. Intervals: bootstrap over images.",
        ),
        MetricPart(
            title="Score-free numbers: one-to-one pairs by overlap, no ranking needed",
            rows=[*_matched_rows(summary)],
            note="Read miou_gt together with precision and recall: flooding a photo with objects "
            "raises the first, abstaining raises miou_matched.",
        ),
        *amodal_part(summary),
    ]


def _images(summary: DetectionSummary) -> str:
    return _many(summary.coverage.attempted, "image")


def _with_truth(summary: DetectionSummary) -> str:
    return _many(summary.counts.categories_with_truth, "category")


def _row(summary: DetectionSummary, name: str, value: float | None, over: str) -> MetricRow:
    return MetricRow(name=name, number=number_cell(value, summary.intervals.get(name)), over=over)


def _official_rows(summary: DetectionSummary) -> Iterator[MetricRow]:
    groups = {**summary.counts.areas, **(summary.counts.frequency_groups or {})}
    for metric in detection_protocol(summary.task).metrics:
        group = groups[metric.frequency or metric.area]
        over = (
            f"{_images(summary)}, {_many(group.categories_with_truth, 'category')}, "
            f"{_many(group.truth_instances, 'annotation')}"
        )
        yield _row(summary, metric.name, summary.metrics[metric.name], over)


def _matched_rows(summary: DetectionSummary) -> Iterator[MetricRow]:
    for prefix in ("class_aware", "class_agnostic"):
        measures: Matched = getattr(summary.matched, prefix)
        truths, answers = _many(measures.n_gt, "annotation"), _many(measures.n_dt, "prediction")
        over = {
            "miou_gt_micro": truths,
            "miou_gt_macro": _with_truth(summary),
            "miou_matched": _many(measures.n_matched, "pair"),
            "precision_50": answers,
            "recall_50": truths,
            "label_accuracy": _many(measures.n_hits_50, "pair") + " at IoU 0.5",
        }
        for name, value in measures.values().items():
            default = f"{truths}, {answers}"
            yield _row(summary, f"{prefix}.{name}", value, over.get(name, default))


def _tie_rows(summary: DetectionSummary) -> Iterator[MetricRow]:
    over = f"{_images(summary)}, {_with_truth(summary)}"
    blocks = [("", summary.ties)]
    equal = summary.equal_confidence
    ap = number_cell(
        equal.metrics["AP"], summary.intervals.get("AP") if equal.already_equal else None
    )
    yield MetricRow(name="equal_confidence.AP", number=ap, over=over)
    if not equal.already_equal:
        blocks.append(("equal_confidence.", equal.ties))
    for prefix, ties in blocks:
        if known := ties.spread:
            yield MetricRow(
                name=f"{prefix}AP over {_many(ties.draws, 'tie order')}",
                number=Number(value=known.expected, sd=known.sd),
                over=_many(ties.n_tied, "tied prediction"),
            )
            yield MetricRow(
                name=f"{prefix}AP bounds over tie orders",
                number=Number(value=None, ends=(known.worst, known.best)),
                over=over,
            )


def notes(summary: DetectionSummary) -> list[str]:
    """The counts behind the numbers, one line each."""
    counts, coverage = summary.counts, summary.coverage
    statuses = ", ".join(f"{n} {name}" for name, n in coverage.by_status.items())
    lines = [
        f"images: {statuses}; {coverage.scored_without_predictions} scored without predictions",
        f"ground truth: {_many(counts.truth_instances, 'instance')} in "
        f"{counts.categories_with_truth} of "
        f"{_many(counts.categories, 'category')}, {counts.truth_ignored} crowd or ignored",
        f"predictions: {counts.predictions}; {counts.lost_to_cap} lost to the cap, "
        f"{counts.unverified_dropped} in unverified categories, "
        f"{counts.empty_masks_dropped} empty; "
        f"{_many(counts.false_positives_in_absent_categories, 'false positive')} in categories "
        "without ground truth here, not penalised",
    ]
    lines += [
        f"AP{letter}: {group.categories_with_truth} of "
        f"{_many(group.categories, 'category')} with truth, "
        f"{_many(group.truth_instances, 'instance')}"
        for letter, group in (counts.frequency_groups or {}).items()
    ]
    if summary.in_space:
        lines.append(_space_line(summary.in_space))
    if summary.partial:
        lines.append("partial run: only some images of its track were attempted")
    lines += [f"warning: {text}" for text in summary.warnings]
    return lines


def _many(count: int, name: str) -> str:
    return plural(count, name, f"{name[:-1]}ies" if name.endswith("y") else f"{name}s")
