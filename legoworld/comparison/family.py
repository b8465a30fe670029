"""The comparison of a family: its metrics, what its bootstrap draws, and what must agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.measures import Draws, Measures, Metric, shared_draws
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.comparison import ComparisonSettings, Images
from legoworld.records.evaluation import DepthRules
from legoworld.tasks.registry import find_family

#: Measures one side over the images that were kept.
Measurer = Callable[[StoredEvaluation], Measures]


@dataclass(frozen=True, kw_only=True)
class SideFacts:
    """What comparison.json says of one side's numbers; None where a family has no such thing."""

    dataset_version: str | None = None
    protocol: DepthRules | None = None
    camera_model: str | None = None
    max_side: int | None = None
    resampled: int | None = None


def _every_image(side: StoredEvaluation) -> NDArray[np.bool_]:
    return np.ones(len(side.rows), bool)


def _no_notes(*_sides: object) -> list[str]:
    return []


@dataclass(frozen=True, kw_only=True)
class ComparisonFamily:
    """How two evaluations of one family are compared.

    metrics: of a task, in display order. unit: what the bootstrap draws. measurer: measures a side
    over the kept images, (images,) bool, with draws that both sides share. images: the selections
    of images that there are rows over; unpaired: those of a selection that is not of pairs.
    centred: whether samples are shifted onto the value. differences: what makes two sides
    incomparable, in words; notes: what to read with the numbers.
    """

    metrics: Callable[[str], list[Metric]]
    unit: Callable[[StoredEvaluation], str]
    measurer: Callable[[StoredEvaluation, Images, NDArray[np.bool_], ComparisonSettings], Measurer]
    images: tuple[Images, ...] = ("attempted", "paired")
    unpaired: Callable[[StoredEvaluation], NDArray[np.bool_]] = _every_image
    centred: bool = False
    facts: Callable[[StoredEvaluation], SideFacts] = lambda _side: SideFacts()
    differences: Callable[[StoredEvaluation, StoredEvaluation], list[str]] = _no_notes
    notes: Callable[[Sequence[StoredEvaluation]], list[str]] = _no_notes


def measure_over_images(
    measure: Callable[[StoredEvaluation, NDArray[np.bool_], Draws], Measures],
) -> Callable[[StoredEvaluation, Images, NDArray[np.bool_], ComparisonSettings], Measurer]:
    """A family's measurer whose bootstrap draws the kept (images,), whichever these are."""

    def measurer(
        _scene: StoredEvaluation,
        _images: Images,
        is_paired: NDArray[np.bool_],
        settings: ComparisonSettings,
    ) -> Measurer:
        draws = shared_draws(int(is_paired.sum()), settings.draws, settings.seed)
        return lambda side: measure(side, is_paired, draws)

    return measurer


def load_comparison_family(task: str) -> ComparisonFamily:
    """The comparison of a task. UsageError, InstallationError."""
    return find_family(task).load("comparison", ComparisonFamily)
