"""Two evaluations of relations: over the questions of the images, one draw for both sides."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.family import ComparisonFamily, measure_over_images
from legoworld.comparison.measures import HEADLINE, TABLE, Draws, Measure, Measures, Metric
from legoworld.evaluation.bootstrap import weighted_sums
from legoworld.evaluation.relations.family import METRICS, POLICIES, metric_sums, ratios, values
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.relations import RelationsRow

_HEADLINE: Final = ("accuracy", "count_exact", "mra", "refer_50")


def _metrics(_task: str) -> list[Metric]:
    return [
        Metric(
            id=f"{name}.{policy}",
            policy=policy,
            better="lower" if name == "count_error" else "higher",
            level=HEADLINE if name in _HEADLINE else TABLE,
        )
        for name, guessed in METRICS.items()
        for policy in (POLICIES if guessed else POLICIES[:1])
    ]


def _measure(side: StoredEvaluation, is_paired: NDArray[np.bool_], draws: Draws) -> Measures:
    rows: list[RelationsRow] = side.kept_rows(is_paired)
    measures = {}
    for name, guessed in METRICS.items():
        sums = metric_sums(name, rows)
        whole = values(name, sums)
        samples = ratios(name, sums, lambda column: weighted_sums(draws.counts, column))
        for k, policy in enumerate(POLICIES if guessed else POLICIES[:1]):
            measures[f"{name}.{policy}"] = Measure(
                value=float(whole[k]), samples=samples[k], over={"images": len(rows)}
            )
    return measures


COMPARISON: Final = ComparisonFamily(
    metrics=_metrics, unit=lambda _side: "image", measurer=measure_over_images(_measure)
)
