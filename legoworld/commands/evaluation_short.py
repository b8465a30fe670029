"""The output of `legoworld evaluate` without -v: the headline numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from legoworld.pluralize import counted

if TYPE_CHECKING:
    from legoworld.records.evaluation_summary import (
        Coverage,
        DepthCoverage,
        DepthSummary,
        DetectionSummary,
        Interval,
        Summary,
    )

#: Maximum number of lines of one kind.
_SHORT: Final = 3


def short_detections(summary: DetectionSummary) -> str:
    """AP with its interval and denominators, tie orders, recall at IoU 0.5, warnings."""
    metrics, counts = summary.metrics, summary.counts
    over = (
        f"{counted(counts.categories_with_truth, 'category', 'categories')}, "
        f"{counted(counts.truth_instances, 'annotation', 'annotations')}"
    )
    lines = [
        f"{_first(summary)}, {summary.iou_type}: {_images(summary.coverage)}",
        f"AP {_value(metrics['AP'])}{_interval(summary.intervals.get('AP'))}, "
        f"AP50 {_value(metrics['AP50'])}, AP75 {_value(metrics['AP75'])} over {over}",
    ]
    ties = summary.ties
    if ties.n_tied:
        lines.append(
            f"AP over {counted(ties.draws, 'tie order', 'tie orders')}: "
            f"{_value(ties.expected)}, between {_value(ties.worst)} and {_value(ties.best)}"
        )
    matched = summary.matched.class_aware
    lines.append(
        f"at IoU 0.5: recall {_value(matched.recall_50)} of "
        f"{counted(matched.n_gt, 'annotation', 'annotations')}, "
        f"precision {_value(matched.precision_50)} of "
        f"{counted(matched.n_dt, 'prediction', 'predictions')}; mean IoU "
        f"{_value(matched.miou_gt_micro)}"
    )
    return "\n".join([*lines, *_ends(summary)])


def short_depth(summary: DepthSummary) -> str:
    """AbsRel and delta1 under each hole policy with denominators, and the unscored images."""
    lines = [
        f"{_first(summary)}, camera model {summary.protocol.camera_model}: "
        f"{_images(summary.coverage)}{of_eth3d(summary.coverage)}"
    ]
    for metric in ("abs_rel", "delta1"):
        by_policy = summary.metrics.get(metric, {})
        shown = (
            f"{policy} {_value(value)}{_interval(summary.intervals[metric][policy])}"
            for policy, value in by_policy.items()
        )
        lines.append(f"{metric}: {', '.join(shown)}")
    rows = summary.not_scored
    lines += [f"{r.status}: {r.file_name}: {r.reason}" for r in rows[:_SHORT]]
    if len(rows) > _SHORT:
        more = counted(len(rows) - _SHORT, "more image", "more images")
        lines.append(f"... and {more} without a score (-v lists all)")
    return "\n".join(lines)


def of_eth3d(coverage: DepthCoverage) -> str:
    """How much of ETH3D was attempted, if the images are ETH3D's."""
    part = coverage.eth3d
    if not part:
        return ""
    return (
        f" ({part.images} of ETH3D's {part.of_images}, in {part.scenes} of "
        f"{counted(part.of_scenes, 'scene', 'scenes')})"
    )


def _first(summary: Summary) -> str:
    return f"{summary.evaluator.name} {summary.evaluator.version}"


def _images(coverage: Coverage) -> str:
    return (
        f"{counted(coverage.attempted, 'image', 'images')} attempted, {coverage.scored} "
        f"scored, {coverage.with_truth} with truth"
    )


def _ends(summary: DetectionSummary) -> list[str]:
    lines = ["partial run: only some images of its track were attempted"] * summary.partial
    lines += [f"warning: {text}" for text in summary.warnings[:_SHORT]]
    if len(summary.warnings) > _SHORT:
        more = counted(len(summary.warnings) - _SHORT, "more warning", "more warnings")
        lines.append(f"... and {more} (-v lists all)")
    return lines


def _value(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _interval(interval: Interval | None) -> str:
    return " [{:.4f}, {:.4f}]".format(*interval.ends) if interval and interval.ends else ""
