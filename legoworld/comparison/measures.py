"""A number of one side and the difference of two sides, with intervals from the same draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.bootstrap import centred_interval, interval, resample_counts
from legoworld.evaluation.detection.problem import Floats
from legoworld.records.base import number
from legoworld.records.comparison import Better, ComparisonRow, Difference, Images, Level, Measured
from legoworld.records.evaluation import Interval

HEADLINE: Final = 1
TABLE: Final = 2
EVERYTHING: Final = 3


@dataclass(frozen=True, kw_only=True)
class Metric:
    """The metric of a comparison row. id: unique among a task's metrics."""

    id: str
    policy: str
    better: Better
    level: Level


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A metric of one side over one selection of images.

    value: NaN where undefined. samples: (draws,) of the bootstrap, None if there is no interval.
    over: its denominators. extra: further values, such as `sd`.
    """

    value: float
    samples: Floats | None
    over: Mapping[str, int]
    extra: Mapping[str, float] = field(default_factory=dict)


Measures = dict[str, Measure]


@dataclass(frozen=True, kw_only=True)
class Draws:
    """Bootstrap draws over a selection of images, shared by both sides. counts: (draws, images)."""

    counts: NDArray[np.int32]
    draws: int
    seed: int


def shared_draws(n_images: int, draws: int, seed: int) -> Draws:
    """The draws over this number of images; independent of the side, so both sides share them."""
    return Draws(counts=resample_counts(n_images, draws, seed), draws=draws, seed=seed)


@dataclass(frozen=True, kw_only=True)
class IntervalRule:
    """evaluate's rule. centred: samples are shifted onto the value; unit: the resampling unit."""

    centred: bool
    unit: str

    def interval(
        self, samples: Floats | None, value: float, *, least: float = 0.0
    ) -> Interval | None:
        """The interval of (draws,) samples; None without any. least: -1 for a difference of two."""
        if samples is None:
            return None
        if self.centred:
            return centred_interval(samples, value, unit=self.unit, least=least)
        return interval(samples, unit=self.unit)


def comparison_row(
    metric: Metric, images: Images, scene: Measure, baseline: Measure, rule: IntervalRule
) -> ComparisonRow:
    """A row of comparison.json. Differences are taken per draw, before the percentiles."""
    samples = None
    if scene.samples is not None and baseline.samples is not None:
        samples = scene.samples - baseline.samples
    difference = scene.value - baseline.value
    return ComparisonRow(
        metric=metric.id,
        policy=metric.policy,
        images=images,
        better=metric.better,
        level=metric.level,
        scene=_side(scene, rule),
        baseline=_side(baseline, rule),
        difference=Difference(
            value=number(difference), interval=rule.interval(samples, difference, least=-1.0)
        ),
    )


def _side(measure: Measure, rule: IntervalRule) -> Measured:
    return Measured(
        value=number(measure.value),
        interval=rule.interval(measure.samples, measure.value),
        over=dict(measure.over),
        **{name: number(value) for name, value in measure.extra.items()},
    )
