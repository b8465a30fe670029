"""The numbers behind the page's plots: curves, histograms, and depth error against depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.matching.outcomes import (
    EQUAL,
    FALSE_POSITIVE,
    OWN,
    TRUE_POSITIVE,
    MatchTable,
    table_from,
)
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.accumulation import (
    precision_at_recalls,
)
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.report_tables import DepthError, IouHistogram, PrecisionRecall
from legoworld.report.detection_images import SideImage

#: Random orders of equally confident predictions that a band is of.
_ORDERS: Final = 100
_PERCENT: Final = (2.5, 97.5)
_PLACES: Final = 4
_IOU_EDGES: Final = tuple(round(0.1 + 0.05 * k, 2) for k in range(19))
_DEPTH_BINS: Final = 24
_DEPTH_PERCENT: Final = (10, 50, 90)

Floats = NDArray[np.float64]


def precision_recall(side: StoredEvaluation) -> list[PrecisionRecall]:
    """The curve under a side's own scores, and under equal ones where those differ."""
    own = _curve(side, OWN, seed=side.detection.ties.seed)
    if side.detection.equal_confidence.already_equal:
        return [own] if own else []
    equal = _curve(side, EQUAL, seed=side.detection.equal_confidence.ties.seed)
    return [curve for curve in (own, equal) if curve]


def _curve(side: StoredEvaluation, policy: str, seed: int) -> PrecisionRecall | None:
    """The mean curve at IoU 0.5 with its band; None where no category has ground truth."""
    table = table_from(side.matches, policy)
    scored = table.truths_per_category[0]
    rows = [(s, int(scored[k])) for k, s in enumerate(table.category_slices) if scored[k]]
    if not rows:
        return None
    states = table.state[0, detection_protocol(side.task).grid.half]
    tied = any(len(np.unique(table.score[s])) < s.stop - s.start for s, _ in rows)
    low = high = np.zeros(0)
    if tied:
        random = np.random.default_rng(seed)
        orders = [_mean_curve(states, rows, table, random) for _ in range(_ORDERS)]
        low, high = np.percentile(orders, _PERCENT, axis=0)
    return PrecisionRecall(
        label=side.name,
        policy="own scores" if policy == OWN else "equal confidence",
        categories=len(rows),
        precision=_round_values(_mean_curve(states, rows, table, None)),
        low=_round_values(low),
        high=_round_values(high),
        draws=_ORDERS if tied else 0,
    )


def _mean_curve(
    states: NDArray[np.uint8],
    rows: Sequence[tuple[slice, int]],
    table: MatchTable,
    random: np.random.Generator | None,
) -> Floats:
    """(101,) mean over categories; random: shuffles what is equally confident."""
    total = np.zeros(101)
    for where, n_truths in rows:
        state = states[where]
        if random is not None:
            state = state[np.lexsort((random.random(len(state)), -table.score[where]))]
        true, false = state == TRUE_POSITIVE, state == FALSE_POSITIVE
        total += precision_at_recalls(true[None], false[None], n_truths)[0]
    mean: Floats = total / len(rows)
    return mean


@dataclass(kw_only=True)
class IouCounts:
    """An IoU histogram that grows image by image."""

    tp: list[float] = field(default_factory=list)
    low: list[float] = field(default_factory=list)

    def add(self, side: SideImage) -> None:
        """The pairs of one image."""
        for entry, kind, iou in zip(side.entries, side.errors.kind, side.errors.iou, strict=True):
            if iou is None:
                continue
            if entry.outcome_50 == "tp":
                self.tp.append(iou)
            elif kind == "localisation":
                self.low.append(iou)

    def histogram(self, label: str) -> IouHistogram:
        """The bins, from 0.1 to 1."""
        tp, low = (np.histogram(values, _IOU_EDGES)[0].tolist() for values in (self.tp, self.low))
        return IouHistogram(label=label, edges=_IOU_EDGES, tp=tuple(tp), low=tuple(low))


@dataclass(kw_only=True)
class DepthPixels:
    """The drawn pixels of a side's scored photos: true depth, and relative error beside it."""

    truth_z_m: list[Floats] = field(default_factory=list)
    error: list[Floats] = field(default_factory=list)

    def add(self, truth_z_m: NDArray[np.float32], aligned_z_m: NDArray[np.float32]) -> None:
        """One (H, W) photo; pixels without a truth or without a prediction are left out."""
        known = np.isfinite(truth_z_m) & np.isfinite(aligned_z_m) & (truth_z_m > 0)
        truth = truth_z_m[known].astype(np.float64)
        self.truth_z_m.append(truth)
        self.error.append(np.abs(aligned_z_m[known] - truth) / truth)

    def plot(self, label: str) -> DepthError | None:
        """Percentiles in bins of equal ratio; None without a pixel."""
        truth = np.concatenate([*self.truth_z_m, np.zeros(0)])
        error = np.concatenate([*self.error, np.zeros(0)])
        if not len(truth):
            return None
        edges = np.geomspace(truth.min(), truth.max() * (1 + 1e-9), _DEPTH_BINS + 1)
        place = np.clip(np.searchsorted(edges, truth, side="right") - 1, 0, _DEPTH_BINS - 1)
        order = np.argsort(place, kind="stable")
        cells = np.split(error[order], np.searchsorted(place[order], np.arange(1, _DEPTH_BINS)))
        percentiles = [
            np.percentile(c, _DEPTH_PERCENT).tolist() if len(c) else [None] * 3 for c in cells
        ]
        low, median, high = (
            tuple(None if v is None else round(v, 5) for v in column)
            for column in zip(*percentiles, strict=True)
        )
        return DepthError(
            label=label,
            edges_m=_round_values(edges),
            n=tuple(len(c) for c in cells),
            low=low,
            median=median,
            high=high,
        )


def _round_values(values: Floats) -> tuple[float, ...]:
    return tuple(round(float(v), _PLACES) for v in values)
