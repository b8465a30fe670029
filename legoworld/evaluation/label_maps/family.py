"""What a family of label maps says of itself, and the sums of its rows by category."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld import exit_codes
from legoworld.cards import Card
from legoworld.errors import LegoWorldError
from legoworld.evaluation.bootstrap import weighted_sums
from legoworld.evaluation.run import Run
from legoworld.records.label_maps import LabelMapRow, LabelMapView, MatchedSegment
from legoworld.records.run_rows import RunRow
from legoworld.tasks.task import Family
from legoworld.tracks.vocabulary import Vocabulary


class MapTruthError(LegoWorldError):
    """The ground truth is missing, unreadable or contradicts the run: nothing can be scored."""

    code = "label_map_truth"


class MapInvalidError(LegoWorldError):
    """A label map, or its list of segments, cannot be scored."""

    code = "label_map"
    status = "invalid"


class MapUnseenError(LegoWorldError):
    """A machine of the cluster does not see the same files as the command."""

    code = "label_map_unseen"
    exit_code = exit_codes.BLOCKED


F64 = NDArray[np.float64]
Counts = dict[int, tuple[int, int, int]]


@dataclass(frozen=True, kw_only=True)
class MapTruth:
    """The ground truth of a run. images: what is needed to load each, by image id; inputs: files.

    rules: of the task, for every image.
    """

    vocabulary: Vocabulary
    images: Mapping[int, Any]
    inputs: Sequence[tuple[str, Path]]
    rules: Any = None


@dataclass(frozen=True, kw_only=True)
class MapItem:
    """One image to measure: its run's row and PNG, None without one, and its truth.

    category_ids: of the vocabulary, ascending.
    """

    row: RunRow
    path: Path | None
    truth: Any
    rules: Any
    category_ids: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One image's integers, and small pictures of it."""

    n_truth: int
    counts: Counts
    view: LabelMapView
    matched: tuple[MatchedSegment, ...] = ()


@dataclass(frozen=True, kw_only=True)
class MapFamily:
    """How answers of one kind are scored. Every function is a module's own, for workers.

    metrics: their names, the first being the main one. find_truth: of a run. measure: an image,
    MapInvalidError for an answer that cannot be scored. values: the metrics of sums (..., K, 4): of
    IoU and the three counts, with (K,) bool of things; NaN where undefined. category_values: the
    numbers of each, (K,). columns: names of the three counts. note: how to read the numbers.
    """

    family: Family
    noun: str
    metrics: tuple[str, ...]
    find_truth: Callable[[Path, Run, Card], MapTruth]
    measure: Callable[[MapItem], Measured]
    values: Callable[[F64, NDArray[np.bool_]], dict[str, F64]]
    category_values: Callable[[F64], dict[str, F64]]
    columns: tuple[str, str, str]
    note: str
    headline: tuple[str, ...] = field(default=())


def present_categories(rows: Sequence[LabelMapRow]) -> list[int]:
    """The category ids that a row has, ascending."""
    return sorted({int(number) for row in rows for number in row.counts})


def total_sums(rows: Sequence[LabelMapRow], category_ids: Sequence[int]) -> F64:
    """(K, 4): the sum of IoU and of the three counts of each category.

    IoU is added match by match in the rows' order, as panopticapi adds it in one process, so that
    the sum is the same to the last bit.
    """
    place = {number: k for k, number in enumerate(category_ids)}
    sums = np.zeros((len(category_ids), 4))
    for row in rows:
        for number, counts in row.counts.items():
            sums[place[int(number)], 1:] += counts
        for match in row.matched:
            sums[place[match.category_id], 0] += match.intersection / match.union
    return sums


def resample_values(
    family: MapFamily,
    rows: Sequence[LabelMapRow],
    category_ids: Sequence[int],
    things: NDArray[np.bool_],
    counts: NDArray[np.int32],
) -> dict[str, F64]:
    """(draws,) of each metric over bootstrap samples. counts: (draws, rows)."""
    sums = np.zeros((len(counts), len(category_ids), 4))
    for k, number in enumerate(category_ids):
        of = [n for n, row in enumerate(rows) if str(number) in row.counts]
        alone = np.array([_category_sums(rows[n], number) for n in of], np.float64)
        drawn = counts[:, of]
        for column in range(4):
            if alone[:, column].any():
                sums[:, k, column] = weighted_sums(drawn, alone[:, column])
    return family.values(sums, things)


def _category_sums(row: LabelMapRow, number: int) -> tuple[float, int, int, int]:
    """A row of `total_sums`, of one image."""
    ious = [m.intersection / m.union for m in row.matched if m.category_id == number]
    return float(in_order(np.array(ious))), *row.counts[str(number)]


def average_defined(values: F64, defined: NDArray[np.bool_]) -> F64:
    """The mean over the last axis (..., K) of what is defined, added in order; NaN of nothing."""
    kept = np.where(defined, values, 0.0)
    return ratio(in_order(kept), defined.sum(axis=-1))


def in_order(values: F64) -> F64:
    """(...) sums over the last axis of (..., K), added from first to last; 0 of nothing."""
    total: F64 = np.add.accumulate(values, axis=-1)[..., -1:].sum(axis=-1)
    return total


def ratio(part: F64, whole: F64) -> F64:
    """part / whole of one shape, NaN where whole is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(whole != 0, part / np.where(whole != 0, whole, 1.0), np.nan)
