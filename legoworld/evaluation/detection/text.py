"""A detection evaluation as text: the evaluator's own lines, then ours with counts."""

from __future__ import annotations

from collections.abc import Sequence

from legoworld.evaluation.detection.protocols import DetectionProtocol, Metric
from legoworld.evaluation.family import TextTable
from legoworld.evaluation.short_text import SHORT, bounds, evaluator_of, fraction, image_counts
from legoworld.pluralize import counted, range_text
from legoworld.records.evaluation_summary import Coverage, DetectionSummary

_TITLES = {"AP": "Average Precision", "AR": "Average Recall"}


def official_lines(protocol: DetectionProtocol, official: Sequence[float]) -> list[str]:
    """The 12 or 13 lines as pycocotools and lvis word them (a test holds them to it)."""
    word = _lvis_line if protocol.federated else _coco_line
    return [word(m, v) for m, v in zip(protocol.metrics, official, strict=True)]


def short_detections(summary: DetectionSummary) -> str:
    """AP with its interval and denominators, tie orders, recall at IoU 0.5, warnings."""
    metrics, counts = summary.metrics, summary.counts
    over = (
        f"{counted(counts.categories_with_truth, 'category', 'categories')}, "
        f"{counted(counts.truth_instances, 'annotation', 'annotations')}"
    )
    lines = [
        f"{evaluator_of(summary)}, {summary.iou_type}: {image_counts(summary.coverage)}",
        f"AP {fraction(metrics['AP'])}{bounds(summary.intervals.get('AP'))}, "
        f"AP50 {fraction(metrics['AP50'])}, AP75 {fraction(metrics['AP75'])} over {over}",
    ]
    ties = summary.ties
    if ties.n_tied:
        lines.append(
            f"AP over {counted(ties.draws, 'tie order', 'tie orders')}: "
            f"{fraction(ties.expected)}, between {fraction(ties.worst)} and {fraction(ties.best)}"
        )
    matched = summary.matched.class_aware
    lines.append(
        f"at IoU 0.5: recall {fraction(matched.recall_50)} of "
        f"{counted(matched.n_gt, 'annotation', 'annotations')}, "
        f"precision {fraction(matched.precision_50)} of "
        f"{counted(matched.n_dt, 'prediction', 'predictions')}; mean IoU "
        f"{fraction(matched.miou_gt_micro)}"
    )
    return "\n".join([*lines, *_ends(summary)])


def _ends(summary: DetectionSummary) -> list[str]:
    lines = ["partial run: only some images of its track were attempted"] * summary.partial
    lines += [f"warning: {text}" for text in summary.warnings[:SHORT]]
    if len(summary.warnings) > SHORT:
        more = counted(len(summary.warnings) - SHORT, "more warning", "more warnings")
        lines.append(f"... and {more} (-v lists all)")
    return lines


def evaluation_text(
    summary: DetectionSummary, protocol: DetectionProtocol, table: TextTable
) -> str:
    """Everything `legoworld evaluate` prints for boxes and masks."""
    evaluator = summary.evaluator
    parts = [
        f"{evaluator.name} {evaluator.version}, {summary.iou_type}, " + _images(summary.coverage),
        "\n".join(official_lines(protocol, summary.official)),
        table(("metric", "value", "95 % interval", "over"), metric_rows(summary, protocol)),
        "\n".join(notes(summary)),
    ]
    return "\n\n".join(parts)


def _coco_line(metric: Metric, value: float) -> str:
    iou = f"{metric.iou:0.2f}" if metric.iou else "0.50:0.95"
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


def _images(coverage: Coverage) -> str:
    return (
        f"{_many(coverage.attempted, 'image')} attempted, {coverage.scored} scored, "
        f"{coverage.with_truth} with truth"
    )


def metric_rows(summary: DetectionSummary, protocol: DetectionProtocol) -> list[tuple[str, ...]]:
    """Every number as (metric, value, 95 % interval, denominator)."""
    counts, coverage = summary.counts, summary.coverage
    images = _many(coverage.attempted, "image")
    with_truth = _many(counts.categories_with_truth, "category")
    categories = f"{images}, {with_truth}"
    rows = []
    groups = {**counts.areas, **(counts.frequency_groups or {})}
    for metric in protocol.metrics:
        group = groups[metric.frequency or metric.area]
        where = (
            f"{images}, {_many(group.categories_with_truth, 'category')}, "
            f"{_many(group.truth_instances, 'annotation')}"
        )
        rows.append(_row(summary, metric.name, summary.metrics[metric.name], where))
    rows += _tie_rows(summary, categories)
    matched = summary.matched
    for prefix, measures in (
        ("class_aware", matched.class_aware),
        ("class_agnostic", matched.class_agnostic),
    ):
        truths = _many(measures.n_gt, "annotation")
        over = {
            "miou_gt_micro": truths,
            "miou_gt_macro": with_truth,
            "miou_matched": _many(measures.n_matched, "pair"),
            "precision_50": _many(measures.n_dt, "prediction"),
            "recall_50": truths,
            "label_accuracy": _many(measures.n_hits_50, "pair") + " at IoU 0.5",
        }
        for name, value in measures.values().items():
            default = f"{truths}, {_many(measures.n_dt, 'prediction')}"
            rows.append(_row(summary, f"{prefix}.{name}", value, over.get(name, default)))
    return rows


def _row(summary: DetectionSummary, name: str, value: float | None, over: str) -> tuple[str, ...]:
    interval = summary.intervals.get(name)
    spread = range_text(interval.ends if value is not None and interval else None)
    return name, "-" if value is None else f"{value:.4f}", spread, over


def _tie_rows(summary: DetectionSummary, over: str) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    blocks = [("", summary.ties)]
    equal = summary.equal_confidence
    if not equal.already_equal:
        blocks.append(("equal confidence: ", equal.ties))
        rows.append(("equal confidence: AP", _value(equal.metrics["AP"]), "-", over))
    for prefix, ties in blocks:
        if known := ties.spread:
            rows.append(
                (
                    f"{prefix}AP over {_many(ties.draws, 'tie order')}",
                    f"{known.expected:.4f}",
                    f"sd {known.sd:.4f}",
                    _many(ties.n_tied, "tied prediction"),
                )
            )
            bounds = range_text((known.worst, known.best))
            rows.append((f"{prefix}AP bounds over tie orders", "-", bounds, over))
    return rows


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
    if summary.partial:
        lines.append("partial run: only some images of its track were attempted")
    lines += [f"warning: {text}" for text in summary.warnings]
    return lines


def _many(count: int, name: str) -> str:
    return counted(count, name, f"{name[:-1]}ies" if name.endswith("y") else f"{name}s")


def _value(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"
