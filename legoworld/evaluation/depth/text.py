"""A depth evaluation as text: means by hole policy, and what they hide."""

from __future__ import annotations

from legoworld.evaluation.family import TextTable
from legoworld.evaluation.short_text import SHORT, bounds, evaluator_of, fraction, image_counts
from legoworld.pluralize import counted, range_text
from legoworld.records.depth import DepthCoverage, DepthSummary


def short_depth(summary: DepthSummary) -> str:
    """AbsRel and delta1 under each hole policy with denominators, and the unscored images."""
    lines = [
        f"{evaluator_of(summary)}, camera model {summary.protocol.camera_model}: "
        f"{image_counts(summary.coverage)}{_of_eth3d(summary.coverage)}"
    ]
    for metric in ("abs_rel", "delta1"):
        by_policy = summary.metrics.get(metric, {})
        shown = (
            f"{policy} {fraction(value)}{bounds(summary.intervals[metric][policy])}"
            for policy, value in by_policy.items()
        )
        lines.append(f"{metric}: {', '.join(shown)}")
    rows = summary.not_scored
    lines += [f"{r.status}: {r.file_name}: {r.reason}" for r in rows[:SHORT]]
    if len(rows) > SHORT:
        more = counted(len(rows) - SHORT, "more image", "more images")
        lines.append(f"... and {more} without a score (-v lists all)")
    return "\n".join(lines)


def _of_eth3d(coverage: DepthCoverage) -> str:
    """How much of ETH3D was attempted, if the images are ETH3D's."""
    part = coverage.eth3d
    if not part:
        return ""
    return (
        f" ({part.images} of ETH3D's {part.of_images}, in {part.scenes} of "
        f"{counted(part.of_scenes, 'scene', 'scenes')})"
    )


def depth_text(summary: DepthSummary, table: TextTable) -> str:
    """Means per hole policy beside those of the constant, with intervals and denominators."""
    coverage, groups = summary.coverage, summary.bootstrap
    rows = []
    for metric, by_policy in summary.metrics.items():
        for policy, value in by_policy.items():
            spread = range_text(summary.intervals[metric][policy].ends)
            constant = summary.constant[metric][policy]
            shown = ["-" if x is None else f"{x:.4f}" for x in (value, constant)]
            rows.append((metric, policy, shown[0], spread, shown[1]))
    evaluator, protocol = summary.evaluator, summary.protocol
    header = ("metric", "holes", "mean", "95 % interval", "constant")
    every = summary.all_attempted
    lines = [
        f"{evaluator.name} {evaluator.version}, camera model {protocol.camera_model}, "
        f"{counted(coverage.attempted, 'image', 'images')} attempted, {coverage.scored} scored, "
        f"{coverage.with_truth} with truth{_of_eth3d(coverage)}; intervals over "
        f"{counted(groups.groups, groups.unit, groups.unit + 's')}",
        table(header, rows),
        f"over all {counted(every.images, 'image', 'images')} with truth, {every.missing} of them "
        f"without a score at {every.missing_abs_rel:g}: abs_rel "
        + ", ".join(
            f"{policy} {'-' if value is None else format(value, '.4f')}"
            for policy, value in every.abs_rel.items()
        ),
        *_depth_counts(summary),
        *(f"{r.status}: {r.file_name}: {r.reason}" for r in summary.not_scored),
    ]
    return "\n\n".join(lines[:3]) + "".join(f"\n{line}" for line in lines[3:])


def _depth_counts(summary: DepthSummary) -> list[str]:
    """What the means hide: flagged fits, images without ground truth, holes, clamped pixels."""
    by_status = summary.coverage.by_status
    flagged = [f"{by_status.get(name, 0)} {name}" for name in ("inverted", "degenerate", "no_gt")]
    others = [f"{n} {name}" for name, n in by_status.items() if f"{n} {name}" not in flagged]
    shares = {
        "holes": summary.mean_hole_share,
        "outside the view": summary.mean_outside_view_share,
        "clamped": summary.mean_clamped_share,
    }
    return [
        f"images: {', '.join([*others, *flagged])}; "
        f"{summary.worse_than_constant} worse than a constant, "
        f"{summary.resampled} resampled, {counted(summary.warnings, 'warning', 'warnings')}",
        "mean share of truth pixels: "
        + ", ".join(
            f"{name} {'-' if x is None else format(x, '.4f')}" for name, x in shares.items()
        ),
    ]
