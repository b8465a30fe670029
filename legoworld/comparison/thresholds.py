"""--fail-below: thresholds on differences, for regression checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from legoworld.comparison.family import load_comparison_family
from legoworld.errors import UsageError
from legoworld.pluralize import nearest_names
from legoworld.records.comparison import Comparison, ComparisonRow

_PAIRED: Final = "paired."
#: Image sets in order of preference: failing on the worst images must not be an advantage.
_ORDER: Final = ("attempted", "paired")


@dataclass(frozen=True, kw_only=True)
class Threshold:
    """The minimum gain of the scene over a baseline. Gain: the improvement."""

    metric: str
    paired: bool
    least_gain: float


@dataclass(frozen=True, kw_only=True)
class FailedThreshold:
    """A threshold that is not met. gain: None where undefined, which never passes."""

    threshold: Threshold
    baseline: str
    images: str
    gain: float | None

    def __str__(self) -> str:
        gain = "undefined" if self.gain is None else f"{self.gain:+.4f}"
        return (
            f"{self.threshold.metric} over {self.images} images: gain over {self.baseline} "
            f"{gain}, required: at least {self.threshold.least_gain:+g}"
        )


def parse_thresholds(texts: Sequence[str], known: Sequence[str]) -> tuple[Threshold, ...]:
    """METRIC=DELTA texts. UsageError names the nearest of the task's metrics, `known`."""
    return tuple(_parse(text, known) for text in texts)


def _parse(text: str, known: Sequence[str]) -> Threshold:
    name, _, delta = text.rpartition("=")
    paired = name.startswith(_PAIRED)
    metric = name.removeprefix(_PAIRED)
    try:
        least = float(delta)
    except ValueError:
        least = math.nan
    if not name or not math.isfinite(least):
        raise UsageError(
            "--fail-below cannot be read",
            found=repr(text),
            expected="METRIC=DELTA, such as AP=-0.05 or paired.AP=0",
        )
    if metric not in known:
        near = nearest_names(metric, known, cutoff=0.0)
        raise UsageError(
            "--fail-below names no metric of this task",
            found=repr(metric),
            expected=f"one of {len(known)}, nearest: {', '.join(near)}",
        )
    return Threshold(metric=metric, paired=paired, least_gain=least)


def thresholds_by_task(texts: Sequence[str], tasks: Sequence[str]) -> dict[str, list[str]]:
    """The METRIC=DELTA texts of each task that has the metric. UsageError for one of none."""
    known = {task: [m.id for m in load_comparison_family(task).metrics(task)] for task in tasks}
    parsed = [_parse(text, sorted({m for of in known.values() for m in of})) for text in texts]
    return {
        task: [t for t, one in zip(texts, parsed, strict=True) if one.metric in known[task]]
        for task in tasks
    }


def find_failed_thresholds(
    document: Comparison, thresholds: Sequence[Threshold]
) -> list[FailedThreshold]:
    """The thresholds that are not met, against every baseline of a comparison."""
    failed = []
    for threshold in thresholds:
        for pair in document.pairs:
            row = _row(pair.rows, threshold)
            gain = None if row is None else _gain(row)
            if gain is None or gain < threshold.least_gain:
                images = "paired" if row is None else row.images
                failed.append(
                    FailedThreshold(
                        threshold=threshold, baseline=pair.baseline, images=images, gain=gain
                    )
                )
    return failed


def _row(rows: Sequence[ComparisonRow], threshold: Threshold) -> ComparisonRow | None:
    """The metric over attempted images, or over paired ones if requested or the only ones."""
    by_images: dict[str, ComparisonRow] = {
        r.images: r for r in rows if r.metric == threshold.metric
    }
    order = ("paired",) if threshold.paired else _ORDER
    return next((by_images[images] for images in order if images in by_images), None)


def _gain(row: ComparisonRow) -> float | None:
    value = row.difference.value
    if value is None or row.better == "higher":
        return value
    return -value
