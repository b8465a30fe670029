"""Bench: the means of a side over all attempted cases, zeros included, and over the paired ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import load_card
from legoworld.comparison.family import ComparisonFamily, Measurer
from legoworld.comparison.measures import EVERYTHING, HEADLINE, Measure, Measures, Metric
from legoworld.evaluation.bootstrap import GroupDraws, draw_groups
from legoworld.evaluation.reconstruction import means
from legoworld.evaluation.reconstruction.protocol import bench_protocol
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.comparison import ComparisonSettings, Images, Level
from legoworld.records.reconstruction import ReconstructionRow

UNIT: Final = "family"
_HEADLINE: Final = ("V", "R", "A", "S")


def bench_metrics(task: str) -> list[Metric]:
    """V, R, A, S, then F at the other tolerances, then the second card's of a task that has one."""
    found = []
    for measure in _measures(task):
        level: Level = HEADLINE if measure.name in _HEADLINE else EVERYTHING
        found.append(Metric(id=measure.name, policy="-", better="higher", level=level))
    return found


def measure_bench(
    side: StoredEvaluation, images: Images, is_paired: NDArray[np.bool_], shared: GroupDraws
) -> Measures:
    """A side's means over the paired cases. images "paired": V is 1 of all of them, so left out.

    is_paired: (cases,) bool.
    """
    rows: list[ReconstructionRow] = side.kept_rows(is_paired)
    return {
        measure.name: _mean(measure, rows, shared)
        for measure in _measures(side.task)
        if images == "attempted" or measure.name != "V"
    }


def _measures(task: str) -> list[means.Measure]:
    """Those over all attempted cases; what a conditional mean says, the paired images say."""
    protocol = bench_protocol(load_card(task))
    names = [tolerance.name for tolerance in protocol.others]
    known = means.headline(names, second=protocol.x is not None)
    return [measure for measure in known if measure.over == "attempted"]


def _mean(measure: means.Measure, rows: Sequence[ReconstructionRow], shared: GroupDraws) -> Measure:
    values = [measure.value(row) for row in rows]
    defined = [value for value in values if value is not None]
    over = {"images": len(rows), "not valid": sum(not row.valid for row in rows)}
    if len(defined) < len(rows):
        return Measure(value=float("nan"), samples=None, over=over)
    numbers = np.array(defined, np.float64)
    samples = shared.means(numbers, [row.family for row in rows]) if shared.spread else None
    return Measure(value=float(np.mean(numbers)), samples=samples, over=over)


def _notes(sides: Sequence[StoredEvaluation]) -> list[str]:
    """What A's noise and unequal attempts mean for a difference."""
    notes = ["Attempted: a submission that is not valid counts 0. Paired: valid on both sides."]
    for side in sides:
        noise = side.reconstruction.noise
        if noise.reference_sd is not None:
            notes.append(
                f"{side.name}: A of the reference's own renders has a standard deviation of "
                f"{noise.reference_sd:.4f} between seeds ({noise.n_reference} cases)."
            )
    return notes


def _differences(first: StoredEvaluation, other: StoredEvaluation) -> list[str]:
    ours, theirs = (side.reconstruction.protocol.reference_sampling for side in (first, other))
    return [] if ours == theirs else [f"reference sampling {ours} and {theirs}"]


def _measurer(
    scene: StoredEvaluation,
    images: Images,
    is_paired: NDArray[np.bool_],
    settings: ComparisonSettings,
) -> Measurer:
    families = [row.family for row in scene.kept_rows(is_paired)]
    draws = draw_groups(families, settings.draws, settings.seed)
    return lambda side: measure_bench(side, images, is_paired, draws)


COMPARISON: Final = ComparisonFamily(
    metrics=bench_metrics,
    unit=lambda _side: UNIT,
    measurer=_measurer,
    differences=_differences,
    notes=_notes,
)
