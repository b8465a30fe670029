"""What errors cost in AP: one kind in one category is mended, and AP is accumulated again.

The oracles are TIDE's (Bolya et al., ECCV 2020), measured in the task's own AP instead of AP50, and
a missed object is found, as confidently as anything was, instead of forgotten: a category that is
missed whole costs its whole AP.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.grid import HALF, N_THRESHOLDS, Grid
from legoworld.evaluation.detection.matching.matches import match_columns
from legoworld.evaluation.detection.matching.outcomes import (
    IGNORED,
    TRUE_POSITIVE,
    MatchTable,
    table_from,
)
from legoworld.evaluation.detection.problem import Bools, Floats, Ints
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.compiled_accumulation import (
    Bits,
    ordered_precision,
    pack_bits,
)
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.report.detection_images import DetectionImage, SideImage
from legoworld.report.sources import ReportInputError
from legoworld.report.tried import Shift

#: An error kind and the category id it is told of: the object's where one is meant, else the
#: prediction's.
ErrorKey = tuple[str, int]
#: Of detections, at which thresholds they are true and at which they do not count.
Outcomes = tuple[Bits, Bits]
#: Truths, and the IoU with each.
Overlaps = tuple[tuple[int, float], ...]
#: The photos in which everything is displaced by the same pixels.
CAMERA: Final[ErrorKey] = ("camera", -1)
_REMOVED: Final = ("background", "both", "duplicate")
#: The evaluator adds the same numbers in another order.
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, kw_only=True)
class ApCosts:
    """gain: what AP gains where the errors of a key are mended, all else left as it is.

    ap: over all images; ap_scored: over those that have an answer, None where that is all or none.
    """

    ap: float | None
    ap_scored: float | None
    gain: dict[ErrorKey, float]


@dataclass(frozen=True, kw_only=True)
class _Extra:
    """A detection as mended: what it overlaps, by truth. order: its place among equal scores."""

    image: int
    score: float
    order: int
    overlaps: Overlaps


@dataclass(kw_only=True)
class MendedAp:
    """Collects one side's images, then mends. `add` every image once, in any order.

    images_by_error: image ids of each error, by its key; failed_images: those without an answer.
    """

    side: StoredEvaluation
    images_by_error: dict[ErrorKey, list[int]] = field(default_factory=lambda: defaultdict(list))
    failed_images: list[int] = field(default_factory=list)
    _image_truths: list[tuple[Ints, Ints, Bools, Bools]] = field(default_factory=list)
    _pairs: list[tuple[Ints, Ints, Floats]] = field(default_factory=list)
    _entries: dict[ErrorKey, list[int]] = field(default_factory=lambda: defaultdict(list))
    _moved: dict[ErrorKey, list[tuple[int, int, float]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    _shifted: dict[int, list[tuple[int, tuple[tuple[int, float], ...]]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    _missed: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    _n_truths: int = 0

    def add(self, image: DetectionImage, answer: SideImage, shift: Shift | None = None) -> None:
        """Take an image's overlaps and its errors. shift: its predictions with another camera."""
        errors, first = answer.errors, self._n_truths
        at = np.full(len(image.truths), image.image.id, np.int64)
        categories = np.array([t.category_id for t in image.truths], np.int64)
        ignored = np.array([s == "ignored" for s in errors.truth], bool)
        crowd = ignored & (np.array([bool(t.iscrowd) for t in image.truths], bool))
        self._image_truths.append((at, categories, ignored, crowd))
        self._n_truths += len(image.truths)
        mine = np.array([p.category_id for p in answer.entries], np.int64)
        d, g = np.nonzero((mine[:, None] == categories) & (answer.iou > 0))
        self._pairs.append((np.array(answer.places, np.int64)[d], first + g, answer.iou[d, g]))
        if answer.run_row.status != "ok":
            self.failed_images.append(image.image.id)
            return
        for place, (key, about, iou) in zip(
            answer.places, prediction_errors(image, answer), strict=True
        ):
            if key is None:
                continue
            self.images_by_error[key].append(image.image.id)
            self._entries[key].append(place)
            if about is not None and errors.truth[about] != "found":
                self._moved[key].append((place, first + about, iou))
        if shift is not None:
            self.images_by_error[CAMERA].append(image.image.id)
            for place, entry, iou in zip(answer.places, answer.entries, shift.iou, strict=True):
                met = np.flatnonzero((categories == entry.category_id) & (iou > 0))
                overlaps = zip((first + met).tolist(), iou[met].tolist(), strict=True)
                self._shifted[entry.category_id].append((place, tuple(overlaps)))
        for t, state in enumerate(errors.truth):
            if state == "missed":
                category = image.truths[t].category_id
                self.images_by_error["missed", category].append(image.image.id)
                self._missed[category].append(first + t)

    def costs(self, metric: Literal["AP", "AP50"] = "AP") -> ApCosts:
        """What each kind of error in each category costs. ReportInputError where AP differs."""
        grid = detection_protocol(self.side.task).grid
        mender = _Mender(self, grid, grid.thresholds(None if metric == "AP" else HALF))
        ap = mender.mean(mender.base)
        stated = self.side.detection.metrics[metric]
        if (ap is None) != (stated is None) or abs((ap or 0.0) - (stated or 0.0)) > _ROUNDING:
            raise ReportInputError(
                "matches.npz does not repeat the evaluation's AP",
                found=f"{metric} {ap}",
                expected=f"{metric} {stated}, as summary.json says",
                next_step="evaluate again",
            )
        return ApCosts(
            ap=ap, ap_scored=mender.mean_of_scored(), gain=mender.gains() if ap is not None else {}
        )


def prediction_errors(
    image: DetectionImage, answer: SideImage
) -> list[tuple[ErrorKey | None, int | None, float]]:
    """Of every prediction: the key of its error, if it is one, the truth it is about, their IoU."""
    found: list[tuple[ErrorKey | None, int | None, float]] = []
    errors = answer.errors
    for entry, kind, about, iou in zip(
        answer.entries, errors.kind, errors.about, errors.iou, strict=True
    ):
        means = kind == "classification" and about is not None
        category = image.truths[about or 0].category_id if means else entry.category_id
        found.append((None if kind is None else (kind, category), about, iou or 0.0))
    return found


class _Mender:
    """The match table of a side, and what it takes to match a category again.

    thresholds: those of the grid that precision is averaged over.
    """

    def __init__(self, mended_ap: MendedAp, grid: Grid, thresholds: Bools) -> None:
        self._mended = mended_ap
        self._grid = replace(grid, areas=grid.areas[:1], ranges=grid.ranges[:1])
        # As many as the compiled accumulation is a mean of, each equally often.
        self._thresholds = np.resize(np.flatnonzero(thresholds), N_THRESHOLDS)
        self._table: MatchTable = table_from(mended_ap.side.matches)
        table = self._table
        self._slices = table.category_slices
        self._n_truths = table.truths_per_category[0]
        columns = zip(*mended_ap._image_truths, strict=True)
        image, category, self._ignored, self._crowd = map(np.concatenate, columns)
        self._truth_image = np.searchsorted(table.image_ids, image)
        self._truth_category = np.searchsorted(table.category_ids, category)
        entry, truth, iou = map(np.concatenate, zip(*mended_ap._pairs, strict=True))
        order = np.argsort(entry, kind="stable")
        self._pairs = entry[order], truth[order], iou[order]
        # What is not counted although no ignored truth may have taken it: of its category not all
        # instances are annotated in its image.
        unmatched = table.state[0][-1] == IGNORED
        unmatched &= ~np.isin(table.entry, entry[(iou >= HALF) & self._ignored[truth]])
        cell = table.image * len(table.category_ids) + table.category
        self._partial: Bools = np.isin(cell, cell[unmatched])
        #: Of each entry; -1 of one that was not ranked.
        self._row = np.full(int(table.entry.max(initial=-1)) + 1, -1, np.int64)
        self._row[table.entry] = np.arange(len(table.entry))
        self._outcomes = true, ignored = self._bits(table.state[0])
        self.base = [
            self._precision((true[rows], ignored[rows]), n)
            for rows, n in zip(self._slices, self._n_truths.tolist(), strict=True)
        ]

    def gains(self) -> dict[ErrorKey, float]:
        """AP's gain of every key; those of a category without truth gain nothing."""
        given, gain = self._mended, {}
        n_categories = sum(value is not None for value in self.base)
        for key, entries in given._entries.items():
            kind, k = key[0], self._position(key[1])
            if kind in _REMOVED:
                value = self._without(k, entries)
            elif kind == "localisation":
                moved = [self._extra(e, ((t, 1.0),)) for e, t, _ in self._best(given._moved[key])]
                value = self._matched_again(k, entries, moved)
            else:
                moved = [self._extra(e, ((t, iou),)) for e, t, iou in self._best(given._moved[key])]
                value = self._matched_again(k, (), moved) + self._donor_gain(entries)
            gain[key] = value / n_categories
        top = float(self._table.score.max(initial=0.0)) or 1.0
        for category, truths in given._missed.items():
            found = [
                _Extra(image=int(self._truth_image[t]), score=top, order=-1, overlaps=((t, 1.0),))
                for t in truths
            ]
            k = self._position(category)
            gain["missed", category] = self._matched_again(k, (), found) / n_categories
        if given._shifted:
            gain[CAMERA] = sum(map(self._with_camera, given._shifted)) / n_categories
        return gain

    def _with_camera(self, category: int) -> float:
        """What a category gains where the photos with a better camera have it."""
        shifted, ranked = self._mended._shifted[category], len(self._row)
        seen = [one for one in shifted if one[0] < ranked and self._row[one[0]] >= 0]
        moved = [self._extra(entry, overlaps) for entry, overlaps in seen]
        return self._matched_again(self._position(category), [e for e, _ in seen], moved)

    def mean(self, values: Sequence[float | None]) -> float | None:
        """Over the categories that have truth."""
        defined = [value for value in values if value is not None]
        return sum(defined) / len(defined) if defined else None

    def mean_of_scored(self) -> float | None:
        """AP over the images that have an answer."""
        table = self._table
        failed = np.searchsorted(table.image_ids, self._mended.failed_images)
        if not len(failed) or len(failed) == len(table.image_ids):
            return None
        left = ~np.isin(table.truth_image, failed)
        n = np.bincount(
            table.truth_category[left], table.n_truths[0][left], minlength=len(self._slices)
        ).astype(int)
        answered = ~np.isin(table.image, failed)
        left_of = [np.flatnonzero(answered[rows]) + rows.start for rows in self._slices]
        true, ignored = self._outcomes
        return self.mean(
            [self._precision((true[d], ignored[d]), int(n[k])) for k, d in enumerate(left_of)]
        )

    def _position(self, category: int) -> int:
        return int(np.searchsorted(self._table.category_ids, category))

    def _bits(self, state: NDArray[np.uint8]) -> Outcomes:
        """(D,) at which thresholds each is true, and at which it does not count. state: (T, D)."""
        state = state[self._thresholds]
        return pack_bits(state == TRUE_POSITIVE), pack_bits(state == IGNORED)

    def _precision(self, outcomes: Outcomes, n_truths: int) -> float | None:
        """One category's AP; its detections best first."""
        if not n_truths:
            return None
        true, ignored = outcomes
        some = np.flatnonzero(true | ignored)
        order = np.arange(len(some))[None]
        (value,) = ordered_precision(true[some], ignored[some], order, some - order, n_truths)
        return float(value)

    def _gain(self, k: int, outcomes: Outcomes) -> float:
        before, after = self.base[k], self._precision(outcomes, int(self._n_truths[k]))
        return 0.0 if before is None or after is None else after - before

    def _without(self, k: int, entries: Sequence[int]) -> float:
        """What a category gains where these predictions are never false positives."""
        rows, mine = self._row[list(entries)] - self._slices[k].start, self._slices[k]
        true, ignored = self._outcomes[0][mine], self._outcomes[1][mine].copy()
        ignored[rows] = ~true[rows]
        return self._gain(k, (true, ignored))

    def _donor_gain(self, entries: Sequence[int]) -> float:
        """What the categories gain that these predictions were taken from."""
        by_category: dict[int, list[int]] = defaultdict(list)
        for e in entries:
            by_category[int(self._table.category[self._row[e]])].append(e)
        return sum(self._without(k, some) for k, some in by_category.items())

    def _best(self, moved: Sequence[tuple[int, int, float]]) -> list[tuple[int, int, float]]:
        """One prediction for each truth: the most confident."""
        best: dict[int, tuple[int, int, float]] = {}
        rows = self._row[np.array([entry for entry, _, _ in moved], np.int64)]
        order = np.lexsort((rows, -self._table.score[rows]))
        for one in (moved[k] for k in order):
            best.setdefault(one[1], one)
        return list(best.values())

    def _extra(self, entry: int, overlaps: tuple[tuple[int, float], ...]) -> _Extra:
        row, table = int(self._row[entry]), self._table
        return _Extra(
            image=int(table.image[row]),
            score=float(table.score[row]),
            order=int(table.rank[row]),
            overlaps=overlaps,
        )

    def _matched_again(self, k: int, left_out: Sequence[int], extra: Sequence[_Extra]) -> float:
        """What a category gains with some predictions left out and others as mended."""
        if self.base[k] is None:
            return 0.0
        table, rows = self._table, np.arange(self._slices[k].start, self._slices[k].stop)
        gone = np.zeros(len(rows), bool)
        gone[self._row[np.array(left_out, np.int64)] - self._slices[k].start] = True
        # Images are matched one by one: the others keep their matches.
        changed = np.zeros(len(table.image_ids), bool)
        changed[table.image[rows[gone]]] = True
        changed[[e.image for e in extra]] = True
        again = changed[table.image[rows]]
        rest, rows = rows[~gone & ~again], rows[~gone & again]
        image = np.append(table.image[rows], [e.image for e in extra]).astype(np.int64)
        score = np.append(table.score[rows], [e.score for e in extra])
        rank = np.append(table.rank[rows], [e.order for e in extra])
        partial = np.append(self._partial[rows], np.zeros(len(extra)))
        source = np.append(rows, -1 - np.arange(len(extra))).astype(np.int64)
        order = np.lexsort((rank, -score, image))
        image, source, partial = image[order], source[order], partial[order].astype(bool)
        truths = np.flatnonzero((self._truth_category == k) & changed[self._truth_image])
        truths = truths[np.argsort(self._truth_image[truths], kind="stable")]
        images = np.union1d(image, self._truth_image[truths])
        first_d = np.searchsorted(image, np.append(images, np.iinfo(np.int64).max))
        first_t = np.searchsorted(
            self._truth_image[truths], np.append(images, np.iinfo(np.int64).max)
        )
        iou = self._blocks(image, source, truths, images, (first_d, first_t), extra)
        n = len(image)
        state = match_columns(
            self._grid,
            (first_d, first_t),
            (iou, np.zeros(n, np.int64), np.ones(n), np.ones(n, bool), ~partial),
            (
                np.zeros(len(truths), np.int64), np.ones(len(truths)),
                self._ignored[truths], self._crowd[truths],
            ),
        )[0]  # fmt: skip
        image, score = (
            np.append(image, table.image[rest]),
            np.append(score[order], table.score[rest]),
        )
        by_score = np.lexsort((np.append(rank[order], table.rank[rest]), image, -score))
        both = zip(self._bits(state), self._outcomes, strict=True)
        true, ignored = (np.append(own, all_of[rest])[by_score] for own, all_of in both)
        return self._gain(k, (true, ignored))

    def _blocks(
        self,
        image: Ints,
        source: Ints,
        truths: Ints,
        images: Ints,
        first: tuple[Ints, Ints],
        extra: Sequence[_Extra],
    ) -> Floats:
        """Every image's (detections, truths) overlaps, one after the other, flat."""
        first_d, first_t = first
        n_d, n_t = np.diff(first_d), np.diff(first_t)
        start = np.concatenate([[0], np.cumsum(n_d * n_t)])
        flat = np.zeros(int(start[-1]))
        at = np.searchsorted(images, image)
        base = start[at] + (np.arange(len(image)) - first_d[at]) * n_t[at]
        local = np.zeros(self._mended._n_truths, np.int64)
        local[truths] = (
            np.arange(len(truths)) - first_t[np.searchsorted(images, self._truth_image[truths])]
        )
        entry, truth, iou = self._pairs
        kept = np.flatnonzero(source >= 0)
        mine = self._table.entry[source[kept]]
        low, high = np.searchsorted(entry, mine), np.searchsorted(entry, mine, side="right")
        which = np.repeat(kept, high - low)
        some = _ranges(low, high)
        flat[base[which] + local[truth[some]]] = iou[some]
        for d in np.flatnonzero(source < 0):
            for t, overlap in extra[-1 - int(source[d])].overlaps:
                flat[base[d] + local[t]] = overlap
        return flat


def _ranges(low: Ints, high: Ints) -> Ints:
    """low[0] .. high[0] - 1, low[1] .. high[1] - 1, and so on."""
    counts = high - low
    offset = np.repeat(low - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
    ranges: Ints = np.arange(int(counts.sum())) + offset
    return ranges
