"""The summary of a depth evaluation: means over images, intervals over scenes, denominators."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from legoworld.evaluation.bootstrap import LEVEL, interval, resample_counts, resampled_means
from legoworld.evaluation.depth.eth3d import scene_of, training_images
from legoworld.evaluation.depth.protocol import (
    EXCLUDE_METRICS,
    HOLE_METRICS,
    HOLE_POLICIES,
    DepthProtocol,
    HolePolicy,
)
from legoworld.records.base import UNSET, UnsetType
from legoworld.records.evaluation_rows import DepthRow, Metrics, ScoredDepthRow
from legoworld.records.evaluation_summary import (
    AllAttempted,
    DepthBootstrap,
    DepthCoverage,
    DepthSummary,
    Evaluator,
    Interval,
    Means,
    NotScored,
    PartOfEth3d,
)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of the command line."""

    camera_model: str
    draws: int
    seed: int


def summarise(
    rows: Sequence[DepthRow],
    *,
    kind: str,
    partial: bool,
    protocol: DepthProtocol,
    settings: Settings,
) -> DepthSummary:
    """summary.json. rows: of every attempted image, ascending id."""
    scored = [row for row in rows if isinstance(row, ScoredDepthRow)]
    with_truth = [row for row in rows if row.status != "no_gt"]
    bootstrap, intervals = _intervals(with_truth, scored, settings)
    return DepthSummary(
        task=protocol.card.task,
        kind=kind,
        partial=partial,
        evaluator=Evaluator(name=protocol.evaluator, version=protocol.evaluator_version),
        protocol=protocol.choices(settings.camera_model),
        coverage=DepthCoverage(
            attempted=len(rows),
            scored=len(scored),
            with_truth=len(with_truth),
            by_status=dict(sorted(Counter(row.status for row in rows).items())),
            eth3d=_part_of_eth3d(rows),
        ),
        metrics=_means([row.metrics for row in scored]),
        constant=_means([row.constant for row in scored]),
        all_attempted=_all_attempted(with_truth, protocol),
        intervals=intervals,
        bootstrap=bootstrap,
        mean_hole_share=_mean([row.hole_share for row in scored]),
        mean_outside_view_share=_mean([row.outside_view_share for row in scored]),
        mean_clamped_share=_mean([row.clamped_share for row in scored]),
        resampled=sum(row.resampled for row in scored),
        worse_than_constant=sum(bool(row.worse_than_constant) for row in scored),
        not_scored=tuple(
            NotScored(
                image_id=row.image_id,
                file_name=row.file_name,
                status=row.status,
                reason=row.reason,
            )
            for row in rows
            if not isinstance(row, ScoredDepthRow)
        ),
        warnings=sum(len(row.warnings) for row in rows),
    )


def metric_policies() -> list[tuple[str, HolePolicy]]:
    """Every defined (metric, hole policy), in display order."""
    pairs: list[tuple[str, HolePolicy]]
    pairs = [(metric, policy) for metric in HOLE_METRICS for policy in HOLE_POLICIES]
    return pairs + [(metric, "exclude") for metric in EXCLUDE_METRICS]


def _part_of_eth3d(rows: Sequence[DepthRow]) -> PartOfEth3d | UnsetType:
    """The share of ETH3D's training set; UNSET if an image is from another dataset."""
    names = {row.file_name for row in rows}
    whole = {image.file_name for image in training_images()}
    if not names or not names <= whole:
        return UNSET
    scenes, of = ({scene_of(name) for name in some} for some in (names, whole))
    return PartOfEth3d(
        images=len(names), of_images=len(whole), scenes=len(scenes), of_scenes=len(of)
    )


def _means(of_images: Sequence[Metrics]) -> Means:
    """Unweighted means of per-image values; None when nothing was scored."""
    means: Means = {}
    for metric, policy in metric_policies():
        means.setdefault(metric, {})[policy] = _mean([m[metric][policy] for m in of_images])
    return means


def _all_attempted(with_truth: Sequence[DepthRow], protocol: DepthProtocol) -> AllAttempted:
    """AbsRel over every image with ground truth; an unscored one counts with error 1."""
    given = protocol.failed_image_abs_rel
    by_policy: dict[str, float | None] = {
        policy: _mean(
            [
                row.metrics["abs_rel"][policy] if isinstance(row, ScoredDepthRow) else given
                for row in with_truth
            ]
        )
        for policy in HOLE_POLICIES
    }
    missing = sum(not isinstance(row, ScoredDepthRow) for row in with_truth)
    return AllAttempted(
        abs_rel=by_policy, images=len(with_truth), missing=missing, missing_abs_rel=given
    )


def _intervals(
    with_truth: Sequence[DepthRow], scored: Sequence[ScoredDepthRow], settings: Settings
) -> tuple[DepthBootstrap, dict[str, dict[str, Interval]]]:
    """Bootstrap intervals of the means, over the groups of all images with ground truth.

    The groups do not depend on what was scored, so two runs over one track share their draws. With
    only one group the intervals are None.
    """
    by_scene = bool(with_truth) and all(scene_of(row.file_name) for row in with_truth)
    names = sorted({row.group for row in with_truth})
    bootstrap = DepthBootstrap(
        draws=settings.draws,
        seed=settings.seed,
        unit="scene" if by_scene else "image",
        groups=len(names),
        level=LEVEL,
    )
    counts = None
    if len(names) > 1 and scored:
        counts = resample_counts(len(names), settings.draws, settings.seed)
    column = {name: i for i, name in enumerate(names)}
    group_of_row = np.array([column[row.group] for row in scored], np.int64)
    intervals: dict[str, dict[str, Interval]] = {}
    for metric, policy in metric_policies():
        samples = np.full(settings.draws, np.nan)
        if counts is not None:
            values = np.array([row.metrics[metric][policy] for row in scored], np.float64)
            samples = resampled_means(values, group_of_row, counts)
        intervals.setdefault(metric, {})[policy] = interval(samples, unit=bootstrap.unit)
    return bootstrap, intervals


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(np.array(values, np.float64))) if values else None
