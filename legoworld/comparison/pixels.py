"""One array for each image: means of one side over scored, attempted, and paired images."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.family import ComparisonFamily, Measurer, SideFacts
from legoworld.comparison.measures import EVERYTHING, HEADLINE, TABLE, Measure, Measures, Metric
from legoworld.evaluation.bootstrap import GroupDraws, draw_groups
from legoworld.evaluation.pixels.family import PixelFamily, metric_policies
from legoworld.evaluation.pixels.summary import (
    resampling_unit,
)
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import plural
from legoworld.records.comparison import ComparisonSettings, Images, Level
from legoworld.records.pixels import PixelRow, PixelSummary


@dataclass(frozen=True, kw_only=True)
class PixelComparison:
    """What is compared of a family, besides its means.

    extra: what else is said of the mean of scored rows; differences, notes, facts: those of the
    family, after those of all.
    """

    family: PixelFamily
    extra: Callable[[Sequence[Any], str, str], Mapping[str, float]] = lambda *_: {}
    facts: Callable[[StoredEvaluation, SideFacts], SideFacts] = lambda _side, facts: facts
    differences: Callable[[StoredEvaluation, StoredEvaluation], list[str]] = lambda *_: []
    notes: Callable[[Sequence[StoredEvaluation]], list[str]] = lambda _sides: []


def pixel_comparison(family: PixelComparison) -> ComparisonFamily:
    """The comparison of a family."""

    def measurer(
        scene: StoredEvaluation,
        images: Images,
        is_paired: NDArray[np.bool_],
        settings: ComparisonSettings,
    ) -> Measurer:
        groups = [row.group for row in scene.kept_rows(is_paired)]
        draws = draw_groups(groups, settings.draws, settings.seed)
        return lambda side: measure_pixels(family, side, images, is_paired, draws)

    return ComparisonFamily(
        metrics=lambda _task: list_pixel_metrics(family.family),
        unit=lambda side: resampling_unit([row for row in _rows(side) if row.has_truth]),
        measurer=measurer,
        images=("scored", "attempted", "paired"),
        unpaired=lambda side: np.array([row.has_truth for row in side.rows], bool),
        facts=lambda side: family.facts(side, _facts(side)),
        differences=lambda first, other: (
            family.differences(first, other) + _size_differences(first, other, family.family)
        ),
        notes=lambda sides: _notes(sides, family),
    )


def list_pixel_metrics(family: PixelFamily) -> list[Metric]:
    """Every metric and hole policy, in display order."""
    metrics = []
    for metric in family.metrics:
        level: Level = EVERYTHING if metric.detail else TABLE
        metrics += [
            Metric(
                id=f"{metric.name}.{policy}",
                policy=policy,
                better=metric.better,
                level=HEADLINE if policy in metric.headline else level,
            )
            for policy in metric.policies
        ]
    return metrics


def measure_pixels(
    family: PixelComparison,
    side: StoredEvaluation,
    images: Images,
    is_paired: NDArray[np.bool_],
    shared: GroupDraws,
) -> Measures:
    """Means of one side over the kept images, (images,) bool.

    images "scored": the kept images that this side has scores for; "paired": all kept images are
    scored; "attempted": the one metric that a kept image without a score has a value of.
    """
    rows: list[PixelRow] = side.kept_rows(is_paired)
    pairs = metric_policies(family.family.metrics)
    if images == "attempted":
        metric, summary = family.family.metrics[0].name, cast("Any", side.summary)
        given = float(getattr(summary.all_attempted, f"missing_{metric}"))
        over = {"images": len(rows), "missing": sum(not row.has_score for row in rows)}
        return {
            f"{name}.{policy}": _mean(
                [row.scores[name][policy] if row.scores else given for row in rows],
                rows,
                shared,
                over,
                {},
            )
            for name, policy in pairs
            if name == metric
        }
    scored = [row for row in rows if row.has_score]
    return {
        f"{name}.{policy}": _mean(
            [row.scores[name][policy] for row in scored if row.scores],
            scored,
            shared,
            {"images": len(scored)},
            family.extra(scored, name, policy),
        )
        for name, policy in pairs
    }


def _mean(
    values: Sequence[float],
    rows: Sequence[PixelRow],
    shared: GroupDraws,
    over: Mapping[str, int],
    extra: Mapping[str, float],
) -> Measure:
    numbers = np.array(values, np.float64)
    value = float(np.mean(numbers)) if len(numbers) else float("nan")
    samples = None
    if shared.spread and len(numbers):
        samples = shared.means(numbers, [row.group for row in rows])
    return Measure(value=value, samples=samples, over=over, extra=extra)


def _rows(side: StoredEvaluation) -> list[PixelRow]:
    return cast("list[PixelRow]", list(side.rows))


def _facts(side: StoredEvaluation) -> SideFacts:
    resampled = cast("PixelSummary", side.summary).resampled
    return SideFacts(max_side=_max_side(side), resampled=resampled)


def _max_side(side: StoredEvaluation) -> int | None:
    """What a scene was read out at, where that is smaller than the photos."""
    asked = side.run.configuration.max_side
    return asked if asked and cast("PixelSummary", side.summary).resampled else None


def _size_differences(
    first: StoredEvaluation, other: StoredEvaluation, family: PixelFamily
) -> list[str]:
    """A scene read out below the photos' size cannot be compared with anything of full size."""
    if first.is_scene and other.is_scene:
        if _max_side(first) != _max_side(other):
            return [f"{family.noun} {_size(first)} and {_size(other)}"]
        return []
    for scene, baseline in ((first, other), (other, first)):
        if _max_side(scene) is None:
            continue
        full = [row for row in _rows(baseline) if row.has_score and not row.resampled]
        if full:
            images = plural(len(full), "image", "images")
            return [f"{family.noun} {_size(scene)} and {images} of full size"]
    return []


def _size(side: StoredEvaluation) -> str:
    return "of full size" if _max_side(side) is None else f"resampled from {_max_side(side)} px"


def _notes(sides: Sequence[StoredEvaluation], family: PixelComparison) -> list[str]:
    return [
        "Images scored: each method over its own, so their differences are of other images.",
        *family.notes(sides),
        *(
            f"{side.name}: {resampled} of {side.summary.coverage.scored} {family.family.noun} "
            "maps are smaller than the truth and were resampled to it."
            for side in sides
            if (resampled := _facts(side).resampled)
        ),
    ]
