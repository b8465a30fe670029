"""A depth evaluation as text: means by hole policy, and what they hide."""

from __future__ import annotations

from dataclasses import replace

from legoworld.evaluation.metrics import MetricPart, metric_parts, number
from legoworld.evaluation.pixels.text import attempted_rows, list_few_unscored, list_unscored
from legoworld.evaluation.short_text import bounds, describe_evaluator, fraction, image_counts
from legoworld.pluralize import plural
from legoworld.records.depth import DepthCoverage, DepthSummary


def short_depth(summary: DepthSummary) -> str:
    """AbsRel and delta1 under each hole policy with denominators, and the unscored images."""
    lines = [
        f"{describe_evaluator(summary)}, camera model {summary.protocol.camera_model}: "
        f"{image_counts(summary.coverage)}{_eth3d_note(summary.coverage)}"
    ]
    for metric in ("abs_rel", "delta1"):
        by_policy = summary.metrics.get(metric, {})
        shown = (
            f"{policy} {fraction(value)}{bounds(summary.intervals[metric][policy])}"
            for policy, value in by_policy.items()
        )
        lines.append(f"{metric}: {', '.join(shown)}")
    return "\n".join([*lines, *list_few_unscored(summary)])


def _eth3d_note(coverage: DepthCoverage) -> str:
    """How much of ETH3D was attempted, if the images are ETH3D's."""
    part = coverage.eth3d
    if not part:
        return ""
    return (
        f" ({part.images} of ETH3D's {part.of_images}, in {part.scenes} of "
        f"{plural(part.of_scenes, 'scene', 'scenes')})"
    )


def depth_metrics(summary: DepthSummary) -> list[MetricPart]:
    """Means per hole policy beside those of the constant, with intervals and denominators."""
    (part,) = metric_parts(summary)
    groups = summary.bootstrap
    scenes = plural(groups.groups, "scene", "scenes")
    rows = [
        replace(
            row,
            over=f"{row.over}, {scenes}" if groups.unit == "scene" else row.over,
            constant=number(summary.constant[row.name][row.policy]),
        )
        for row in part.rows
    ]
    rows += attempted_rows(summary, "abs_rel")
    note = (
        "Every depth is aligned by one scale and one shift in disparity before it is scored. Holes "
        "are pixels with measured depth and no prediction: error_1 (primary) counts each as an "
        "error of 100 %, exclude leaves them out, far fills them with the deepest ground truth. "
        "constant is what one depth for the whole photo would score."
    )
    return [MetricPart(title=part.title, rows=rows, note=note)]


def depth_notes(summary: DepthSummary) -> list[str]:
    """What the means hide: flagged fits, images without ground truth, holes, clamped pixels."""
    by_status = summary.coverage.by_status
    flagged = [f"{by_status.get(name, 0)} {name}" for name in ("inverted", "degenerate", "no_gt")]
    others = [f"{n} {name}" for name, n in by_status.items() if f"{n} {name}" not in flagged]
    shares = {
        "holes": summary.mean_hole_share,
        "outside the view": summary.mean_outside_view_share,
        "clamped": summary.mean_clamped_share,
    }
    lines = [
        f"images: {', '.join([*others, *flagged])}; "
        f"{summary.worse_than_constant} worse than a constant, "
        f"{summary.resampled} resampled, {plural(summary.warnings, 'warning', 'warnings')}",
        "mean share of truth pixels: "
        + ", ".join(f"{name} {fraction(x)}" for name, x in shares.items()),
        *list_unscored(summary),
    ]
    return lines + ["partial run: only some images of its track"] * summary.partial
