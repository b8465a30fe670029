"""An evaluation of normals as text: all pixels pooled, and means over images."""

from __future__ import annotations

from legoworld.evaluation.metrics import MetricPart, MetricRow, metric_parts, number
from legoworld.evaluation.normals.protocol import ANGLES, ERROR_90, FAILS
from legoworld.evaluation.pixels.text import attempted_rows, list_few_unscored, list_unscored
from legoworld.evaluation.short_text import describe_evaluator, fraction, image_counts
from legoworld.pluralize import plural
from legoworld.records.normals import NormalsSummary


def short_normals(summary: NormalsSummary) -> str:
    """Pooled numbers under the primary policy with denominators, and the unscored images."""
    pooled = summary.pooled
    angles = [f"{name} {_degrees(pooled[name][ERROR_90])}" for name in ANGLES]
    shares = [f"{name} {fraction(pooled[name][FAILS])}" for name in pooled if name not in ANGLES]
    lines = [
        f"{describe_evaluator(summary)}: {image_counts(summary.coverage)}",
        f"{plural(summary.pooled_px, 'pixel', 'pixels')} pooled: {', '.join([*angles, *shares])}",
    ]
    return "\n".join([*lines, *list_few_unscored(summary)])


def normals_metrics(summary: NormalsSummary) -> list[MetricPart]:
    """The pooled numbers, then the means over images with their intervals."""
    pixels = {True: summary.predicted_px, False: summary.pooled_px}
    pooled = [
        MetricRow(
            name=name,
            policy=policy,
            number=number(value),
            over=plural(pixels[policy == "exclude"], "pixel", "pixels"),
        )
        for name, by_policy in summary.pooled.items()
        for policy, value in by_policy.items()
    ]
    note = (
        "The angle between prediction and ground truth over all valid pixels of the scored images, "
        "in degrees, and the shares strictly below 5, 7.5, 11.25, 22.5 and 30 degrees. Holes are "
        "pixels with a measured normal and no prediction: error_90 (primary) counts each as 90 "
        "degrees, fails counts it in no share, exclude leaves it out."
    )
    (means,) = metric_parts(summary)
    return [
        MetricPart(title="All pixels pooled", rows=pooled, note=note),
        MetricPart(
            title="Means over images",
            rows=[*means.rows, *attempted_rows(summary, ANGLES[0])],
            note="",
        ),
    ]


def normals_notes(summary: NormalsSummary) -> list[str]:
    """What the numbers hide: images without a score, holes, resampled predictions."""
    by_status = ", ".join(f"{n} {name}" for name, n in summary.coverage.by_status.items())
    lines = [
        f"images: {by_status}; {summary.resampled} resampled, "
        f"{plural(summary.warnings, 'warning', 'warnings')}",
        f"mean share of truth pixels that are holes: {fraction(summary.mean_hole_share)}",
        *list_unscored(summary),
    ]
    return lines + ["partial run: only some images of its track"] * summary.partial


def _degrees(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
