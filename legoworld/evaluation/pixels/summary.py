"""Summaries of arrays: means over images, intervals over scenes, denominators; and their text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from legoworld.evaluation.bootstrap import LEVEL, draw_groups, interval
from legoworld.evaluation.metrics import MetricRow, first_few, number_cell
from legoworld.evaluation.pixels.family import (
    PixelFamily,
    PixelMetric,
    PixelProtocol,
    Settings,
    metric_policies,
)
from legoworld.evaluation.run import count_images
from legoworld.pluralize import plural
from legoworld.records.base import UNSET, to_record
from legoworld.records.evaluation import Interval, NotScored
from legoworld.records.pixels import Means, Metrics, PixelBootstrap, PixelRow, PixelSummary


def summarise(
    family: PixelFamily,
    rows: Sequence[PixelRow],
    *,
    kind: str,
    partial: bool,
    protocol: PixelProtocol,
    settings: Settings,
) -> Any:
    """summary.json of a family. rows: of every attempted image, ascending id."""
    scored = [row for row in rows if row.has_score]
    bootstrap, intervals = _intervals(rows, family.metrics, settings)
    records = family.records
    options = {name: settings.options[name] for name in family.options}
    return records.summary(
        task=protocol.card.task,
        kind=kind,
        partial=partial,
        evaluator=protocol.evaluator,
        protocol=to_record(records.choices, protocol.choices | options),
        coverage=records.coverage(rows, count_images(rows)),
        metrics=means([row.scores for row in scored if row.scores], family.metrics),
        intervals=intervals,
        bootstrap=bootstrap,
        all_attempted=records.attempted(**_average_attempted(rows, family.metrics[0], protocol)),
        mean_hole_share=mean([row.hole_share for row in scored if row.hole_share is not UNSET]),
        resampled=sum(bool(row.resampled) for row in scored),
        not_scored=tuple(
            NotScored(
                image_id=row.image_id, file_name=row.file_name, status=row.status, reason=row.reason
            )
            for row in rows
            if not row.has_score
        ),
        warnings=sum(len(row.warnings) for row in rows),
        **family.own(rows, scored, settings),
    )


def _average_attempted(
    rows: Sequence[PixelRow], metric: PixelMetric, protocol: PixelProtocol
) -> dict[str, Any]:
    """A metric over every image with truth, where one without a score has the card's value."""
    with_truth, name = [row for row in rows if row.has_truth], metric.name
    given = protocol.failed_image(name)
    return {
        name: {
            policy: mean([row.scores[name][policy] if row.scores else given for row in with_truth])
            for policy in metric.policies
        },
        "images": len(with_truth),
        "missing": sum(not row.has_score for row in with_truth),
        f"missing_{name}": given,
    }


def means(of_images: Sequence[Metrics], metrics: Sequence[PixelMetric]) -> Means:
    """Unweighted means of per-image values; None when nothing was scored."""
    found: Means = {}
    for metric, policy in metric_policies(metrics):
        found.setdefault(metric, {})[policy] = mean([m[metric][policy] for m in of_images])
    return found


def mean(values: Sequence[float]) -> float | None:
    """The mean in float64; None of nothing."""
    return float(np.mean(np.array(values, np.float64))) if values else None


def resampling_unit(rows: Sequence[PixelRow]) -> Any:
    """What is resampled: scenes if every photo is named after one, otherwise images."""
    named = bool(rows) and all(row.group != row.file_name for row in rows)
    return "scene" if named else "image"


def _intervals(
    rows: Sequence[PixelRow], metrics: Sequence[PixelMetric], settings: Settings
) -> tuple[PixelBootstrap, dict[str, dict[str, Interval]]]:
    """Bootstrap intervals of the means, over the groups of all images with ground truth.

    The groups do not depend on what was scored, so two runs over one track share their draws. With
    only one group the intervals are None.
    """
    with_truth = [row for row in rows if row.has_truth]
    scored = [row for row in rows if row.has_score]
    draws = draw_groups([row.group for row in with_truth], settings.draws, settings.seed)
    bootstrap = PixelBootstrap(
        draws=settings.draws,
        seed=settings.seed,
        unit=resampling_unit(with_truth),
        groups=len(draws.column),
        level=LEVEL,
    )
    intervals: dict[str, dict[str, Interval]] = {}
    for metric, policy in metric_policies(metrics):
        samples = np.full(settings.draws, np.nan)
        if draws.spread and scored:
            values = [row.scores[metric][policy] for row in scored if row.scores]
            samples = draws.means(np.array(values, np.float64), [row.group for row in scored])
        intervals.setdefault(metric, {})[policy] = interval(samples, unit=bootstrap.unit)
    return bootstrap, intervals


def list_unscored(summary: PixelSummary) -> list[str]:
    """A line for each image without a score."""
    return [f"{r.status}: {r.file_name}: {r.reason}" for r in summary.not_scored]


def list_few_unscored(summary: PixelSummary) -> list[str]:
    """The first of these."""
    return first_few(list_unscored(summary), "image without a score", "images without a score")


def attempted_rows(summary: PixelSummary, metric: str) -> list[MetricRow]:
    """A metric over every image with truth."""
    every = cast("Any", summary).all_attempted
    images = plural(every.images, "image", "images")
    given = getattr(every, f"missing_{metric}")
    over = f"{images} with truth, {every.missing} of them without a score at {given:g}"
    return [
        MetricRow(
            name=f"{metric}, all attempted", policy=policy, number=number_cell(value), over=over
        )
        for policy, value in getattr(every, metric).items()
    ]
