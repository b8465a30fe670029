"""What costs a bench R and A: an object's part is the reference's, and each mean is made again.

R of a case is the mean of F over its eligible objects, each measured inside its own mask: of the
reference's own points F is 1, and no other object's F moves. A is a share of pixels.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from legoworld.evaluation.reconstruction.appearance import raster_indices
from legoworld.evaluation.reconstruction.points import Labels
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import plural
from legoworld.records.reconstruction import ReconstructionRow
from legoworld.records.report_tables import SideCosts
from legoworld.report.costs import Finding, Findings, Key, side_costs
from legoworld.report.reconstruction_case import Codes

#: What is around the scored objects.
AROUND: Final = ""


class Loss(NamedTuple):
    """What an object, or what is around all of them, costs the score of one case."""

    image_id: int
    category: str
    amount: float


def surface_losses(row: ReconstructionRow) -> list[Loss]:
    """What each object costs the case's R; nothing of a case that is not valid."""
    eligible = [scored for scored in row.objects if scored.eligible]
    if not row.valid:
        return []
    return [
        Loss(row.image_id, scored.category, (1.0 - scored.f1) / len(eligible))
        for scored in eligible
        if scored.f1 < 1.0
    ]


def picture_losses(row: ReconstructionRow, largest: Codes, label: Labels, delta: int) -> list[Loss]:
    """What each object's pixels, and those around, cost A. largest: (H, W); label: (h, w)."""
    if not row.valid:
        return []
    place = label[raster_indices(largest.shape, label.shape)]
    wrong = np.bincount(place[largest > delta] + 1, minlength=len(row.objects) + 1)
    categories = (AROUND, *(scored.category for scored in row.objects))
    return [
        Loss(row.image_id, category, int(n) / largest.size)
        for category, n in zip(categories, wrong, strict=True)
        if n
    ]


def bench_costs(
    sides: Sequence[StoredEvaluation],
    surfaces: Sequence[Iterable[Loss]],
    pictures: Sequence[Iterable[Loss]],
    ids: Mapping[str, int],
) -> tuple[SideCosts, ...]:
    """What costs every side most R, then A. ids: of the categories."""
    return tuple(
        costs
        for metric, losses in (("R", surfaces), ("A", pictures))
        for costs in side_costs(
            [_findings(metric, *of, ids) for of in zip(sides, losses, strict=True)]
        )
    )


def _findings(
    metric: str, side: StoredEvaluation, losses: Iterable[Loss], ids: Mapping[str, int]
) -> Findings:
    rows, means = side.reconstruction_rows, side.reconstruction.metrics
    by_category: dict[str, list[Loss]] = defaultdict(list)
    for loss in losses:
        by_category[loss.category].append(loss)
    found: dict[Key, Finding] = {}
    for category, some in by_category.items():
        objects = plural(len(some), "object is", "objects are")
        unlike = f"{category}: {objects} unlike the reference"
        some.sort(key=lambda loss: (-loss.amount, loss.image_id))
        found["object", category] = Finding(
            text=unlike if category != AROUND else "what is around the scored objects",
            gain=sum(loss.amount for loss in some) / len(rows),
            images=[loss.image_id for loss in some],
            category=ids.get(category),
        )
    return Findings(
        side=side,
        metric=metric,
        over=f"all {plural(len(rows), 'case', 'cases')} attempted",
        by_error=found,
        n_attempted=len(rows),
        noun="valid submission",
        images="case",
        n_failed=sum(not row.valid for row in rows),
        missing=", each counted as 0",
        value=means[metric].value,
        value_answered=means[f"{metric}_valid"].value,
    )
