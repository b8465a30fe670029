"""Precision, recall and F per object, at every tolerance from one set of distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.reconstruction.correspondence import Correspondence
from legoworld.evaluation.reconstruction.nearest import GridSurface, hits_between
from legoworld.evaluation.reconstruction.points import Labels
from legoworld.evaluation.reconstruction.tolerance import Tolerance


@dataclass(frozen=True, kw_only=True)
class Score:
    """Points of one object (or of all as one) and how many of them are within tau.

    Recall is over reference points, precision over submitted ones, each submitted point held to the
    tau of the reference point nearest to it.
    """

    n_reference: int
    n_submitted: int
    reference_hits: int
    submitted_hits: int

    @property
    def recall(self) -> float:
        """Share of reference points that are hit, 0 where there is none."""
        return self.reference_hits / self.n_reference if self.n_reference else 0.0

    @property
    def precision(self) -> float:
        """Share of submitted points that hit, 0 where there is none."""
        return self.submitted_hits / self.n_submitted if self.n_submitted else 0.0

    @property
    def f1(self) -> float:
        """2 P R / (P + R), 0 where both are 0."""
        both = self.precision + self.recall
        return 2.0 * self.precision * self.recall / both if both > 0 else 0.0


def scores(pairs: Correspondence, objects: int, tolerance: Tolerance) -> list[Score]:
    """One score for each of labels 0 .. objects - 1."""
    hit_ref = pairs.reference_distance_m <= tolerance.tau_m(pairs.reference_z_m)
    hit_sub = pairs.submitted_distance_m <= tolerance.tau_m(pairs.nearest_z_m)
    columns = (
        _count_labels(pairs.reference_label, objects),
        _count_labels(pairs.submitted_label, objects),
        _count_labels(pairs.reference_label[hit_ref], objects),
        _count_labels(pairs.submitted_label[hit_sub], objects),
    )
    return [
        Score(n_reference=g, n_submitted=q, reference_hits=hit_g, submitted_hits=hit_q)
        for g, q, hit_g, hit_q in zip(*(c.tolist() for c in columns), strict=True)
    ]


def scores_on_rasters(
    reference: GridSurface,
    submitted: GridSurface,
    objects: int,
    tolerances: Sequence[Tolerance],
) -> list[list[Score]]:
    """`scores` of two surfaces at each tolerance, without any distance: several times as fast."""
    hits = hits_between(reference, submitted, objects, tolerances)
    sizes = list(zip(hits.n_a.tolist(), hits.n_b.tolist(), strict=True))
    return [
        [
            Score(n_reference=g, n_submitted=q, reference_hits=hit_g, submitted_hits=hit_q)
            for (g, q), hit_g, hit_q in zip(sizes, of_g, of_q, strict=True)
        ]
        for of_g, of_q in zip(hits.a.T.tolist(), hits.b.T.tolist(), strict=True)
    ]


def mean_f1(scores: list[Score]) -> float | None:
    """R: the unweighted mean of F over eligible objects, those that have a reference point."""
    values = [score.f1 for score in scores if score.n_reference]
    return float(np.mean(values)) if values else None


def _count_labels(label: Labels, objects: int) -> NDArray[np.int64]:
    return np.bincount(label, minlength=objects)
