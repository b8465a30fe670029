"""What a family of label maps says of itself; the rest of scoring follows."""

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
from legoworld.evaluation.run import Run
from legoworld.records.label_maps import LabelMapView, MatchedSegment
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
    IoU and the three counts, with (K,) bool of things; NaN where undefined. of_category: the
    numbers of each, (K,). columns: names of the three counts. note: how to read the numbers.
    """

    family: Family
    noun: str
    metrics: tuple[str, ...]
    find_truth: Callable[[Path, Run, Card], MapTruth]
    measure: Callable[[MapItem], Measured]
    values: Callable[[F64, NDArray[np.bool_]], dict[str, F64]]
    of_category: Callable[[F64], dict[str, F64]]
    columns: tuple[str, str, str]
    note: str
    headline: tuple[str, ...] = field(default=())
