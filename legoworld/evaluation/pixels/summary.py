"""Means over images, intervals over scenes, denominators: what summaries of pixels share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.bootstrap import LEVEL, interval, resample_counts, resampled_means
from legoworld.evaluation.pixels.family import PixelMetric, Settings, metric_policies
from legoworld.records.evaluation_summary import Interval, NotScored
from legoworld.records.pixels import Means, Metrics, PixelBootstrap, PixelRow


class Common(TypedDict):
    """The fields that every summary of pixels has, besides those of its card."""

    metrics: Means
    intervals: dict[str, dict[str, Interval]]
    bootstrap: PixelBootstrap
    resampled: int
    not_scored: tuple[NotScored, ...]
    warnings: int


class Covered(TypedDict):
    """The fields of every coverage."""

    attempted: int
    scored: int
    with_truth: int
    by_status: dict[str, int]


def common(rows: Sequence[PixelRow], metrics: Sequence[PixelMetric], settings: Settings) -> Common:
    """Means, intervals and what has no score. rows: of every attempted image, ascending id."""
    bootstrap, intervals = _intervals(rows, metrics, settings)
    return Common(
        metrics=means([row.scores for row in rows if row.scores], metrics),
        intervals=intervals,
        bootstrap=bootstrap,
        resampled=sum(bool(row.resampled) for row in rows if row.has_score),
        not_scored=tuple(
            NotScored(
                image_id=row.image_id,
                file_name=row.file_name,
                status=row.status,
                reason=row.reason,
            )
            for row in rows
            if not row.has_score
        ),
        warnings=sum(len(row.warnings) for row in rows),
    )


def covered(rows: Sequence[PixelRow]) -> Covered:
    """Images by outcome."""
    return Covered(
        attempted=len(rows),
        scored=sum(row.has_score for row in rows),
        with_truth=sum(row.has_truth for row in rows),
        by_status=dict(sorted(Counter(row.status for row in rows).items())),
    )


def means(of_images: Sequence[Metrics], metrics: Sequence[PixelMetric]) -> Means:
    """Unweighted means of per-image values; None when nothing was scored."""
    found: Means = {}
    for metric, policy in metric_policies(metrics):
        found.setdefault(metric, {})[policy] = mean([m[metric][policy] for m in of_images])
    return found


def mean(values: Sequence[float]) -> float | None:
    """The mean in float64; None of nothing."""
    return float(np.mean(np.array(values, np.float64))) if values else None


def with_missing(
    rows: Sequence[PixelRow], metric: str, given: float
) -> Callable[[str], list[float]]:
    """A metric's values under a policy, an image without a score counting as `given`."""
    return lambda policy: [row.scores[metric][policy] if row.scores else given for row in rows]


def unit_of(rows: Sequence[PixelRow]) -> Any:
    """What is resampled: scenes if every photo is named after one, otherwise images."""
    named = bool(rows) and all(row.group != row.file_name for row in rows)
    return "scene" if named else "image"


def group_columns(rows: Sequence[PixelRow]) -> dict[str, int]:
    """The groups of rows, each with its column in the draws."""
    return {name: k for k, name in enumerate(sorted({row.group for row in rows}))}


def group_draws(columns: dict[str, int], draws: int, seed: int) -> NDArray[np.int32] | None:
    """Draws over groups, (draws, groups); None where there are fewer than two."""
    return resample_counts(len(columns), draws, seed) if len(columns) > 1 else None


def mean_samples(
    values: NDArray[np.float64],
    rows: Sequence[PixelRow],
    columns: dict[str, int],
    counts: NDArray[np.int32],
) -> NDArray[np.float64]:
    """(draws,) means of the rows' values, each weighted by how often its group was drawn."""
    groups = np.array([columns[row.group] for row in rows], np.int64)
    return resampled_means(values, groups, counts)


def _intervals(
    rows: Sequence[PixelRow], metrics: Sequence[PixelMetric], settings: Settings
) -> tuple[PixelBootstrap, dict[str, dict[str, Interval]]]:
    """Bootstrap intervals of the means, over the groups of all images with ground truth.

    The groups do not depend on what was scored, so two runs over one track share their draws. With
    only one group the intervals are None.
    """
    with_truth = [row for row in rows if row.has_truth]
    scored = [row for row in rows if row.has_score]
    columns = group_columns(with_truth)
    bootstrap = PixelBootstrap(
        draws=settings.draws,
        seed=settings.seed,
        unit=unit_of(with_truth),
        groups=len(columns),
        level=LEVEL,
    )
    counts = group_draws(columns, settings.draws, settings.seed) if scored else None
    intervals: dict[str, dict[str, Interval]] = {}
    for metric, policy in metric_policies(metrics):
        samples = np.full(settings.draws, np.nan)
        if counts is not None:
            values = [row.scores[metric][policy] for row in scored if row.scores]
            samples = mean_samples(np.array(values, np.float64), scored, columns, counts)
        intervals.setdefault(metric, {})[policy] = interval(samples, unit=bootstrap.unit)
    return bootstrap, intervals
