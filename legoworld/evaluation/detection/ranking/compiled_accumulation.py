"""The compiled loops over many rankings of the same matches: accumulate.cpp behind ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.grid import N_THRESHOLDS, RECALL_THRESHOLDS
from legoworld.evaluation.detection.matching.outcomes import (
    FALSE_POSITIVE,
    IGNORED,
    TRUE_POSITIVE,
)
from legoworld.evaluation.detection.problem import Floats, Ints
from legoworld.evaluation.kernels.library import call, library, pointer, pointers

Bits = NDArray[np.uint16]
Counts = NDArray[np.int32]

_ANY_RANK: Final = int(np.iinfo(np.int32).max)


class _RankingStruct(ctypes.Structure):
    """LwRanking of accumulate.cpp."""

    _fields_: ClassVar = [
        *pointers("image", "block_end", "is_true", "is_ignored", "rank"),
        ("detections", ctypes.c_int64),
        *pointers("recall_thresholds"),
        ("n_recall_thresholds", ctypes.c_int32),
        ("n_thresholds", ctypes.c_int32),
        *pointers("ranks"),
        ("n_ranks", ctypes.c_int32),
    ]


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """One category's detections at one area, by rank, without those ignored at every threshold.

    image, rank: (D,) as in MatchTable; block_end: (D,) where each one's run of the same image and
    score ends; is_true, is_ignored: (D,) bit t is its outcome at threshold t.
    """

    image: Counts
    block_end: Counts
    is_true: Bits
    is_ignored: Bits
    rank: Counts


def rank_category(state: NDArray[np.uint8], image: Ints, score: Floats, rank: Ints) -> Ranking:
    """A category's part of a match table. state: (T, D); the others (D,)."""
    counted = (state != IGNORED).any(axis=0)
    state, image, score, rank = state[:, counted], image[counted], score[counted], rank[counted]
    special = np.flatnonzero((state != FALSE_POSITIVE).any(axis=0))
    n = 0  # what stands below the last that is not false at every threshold changes nothing
    ends = np.append(np.flatnonzero((np.diff(image) != 0) | (np.diff(score) != 0)) + 1, len(image))
    if len(special):
        n = int(ends[np.searchsorted(ends, special[-1], side="right")])
    starts = np.concatenate([[0], ends[:-1]]) if len(image) else ends[:0]
    block_end = np.repeat(ends[: len(starts)], ends[: len(starts)] - starts)
    return Ranking(
        image=image[:n].astype(np.int32),
        block_end=block_end[:n].astype(np.int32),
        is_true=pack_bits(state[:, :n] == TRUE_POSITIVE),
        is_ignored=pack_bits(state[:, :n] == IGNORED),
        rank=rank[:n].astype(np.int32),
    )


def pack_bits(flags: NDArray[np.bool_]) -> Bits:
    """(S,) flags of all thresholds in one number each, threshold t in bit t. flags: (T, S)."""
    weights = 1 << np.arange(len(flags), dtype=np.uint16)
    bits: Bits = np.bitwise_or.reduce(flags * weights[:, None], axis=0)
    return bits


def in_lanes(counts: NDArray[np.int32]) -> NDArray[np.uint16]:
    """(blocks, images, lanes) bootstrap counts as the library reads them: lanes are draws.

    counts: (draws, images) how often each image is in each draw, below 2**16.
    """
    draws, images = counts.shape
    lanes = int(library().lw_lanes())
    blocks = -(-draws // lanes)
    padded = np.zeros((blocks * lanes, images), np.uint16)
    padded[:draws] = counts
    return np.ascontiguousarray(padded.reshape(blocks, lanes, images).transpose(0, 2, 1))


def resample(
    ranking: Ranking, laned: NDArray[np.uint16], n_truths: Counts, ranks: Sequence[int | None]
) -> tuple[Floats, Counts]:
    """Average precision (T, draws) and true positives below each rank (R, T, draws).

    laned: the draws' counts, see `in_lanes`; n_truths: (draws,), above 0. ranks: None counts all.
    The copies of an image stand one after the other, each whole: where two of its detections have
    equal scores, a b becomes a b a b (docs/protocols/ties.md). A draw holds less than 2**31
    detections.
    """
    shape = N_THRESHOLDS, len(n_truths)
    precision = np.zeros(shape)
    limits = np.array([_ANY_RANK if r is None else r for r in ranks], np.int32)
    recalled = np.zeros((len(limits), *shape), np.int32)
    columns = ranking.image, ranking.block_end, ranking.is_true, ranking.is_ignored, ranking.rank
    struct = _RankingStruct(
        *(pointer(c) for c in columns),
        len(ranking.image),
        pointer(RECALL_THRESHOLDS),
        len(RECALL_THRESHOLDS),
        N_THRESHOLDS,
        pointer(limits),
        len(limits),
    )
    n_truths = np.ascontiguousarray(n_truths, np.int32)
    call("lw_resample", struct, laned, len(n_truths), laned.shape[1], n_truths, precision, recalled)
    return precision, recalled


def ordered_precision(
    is_true: Bits, is_ignored: Bits, order: Counts, plain: Counts, n_truths: int
) -> Floats:
    """(n,) AP of one category in n orders of its detections, averaged over thresholds.

    is_true, is_ignored: (S,); order, plain: (n, S) which of them stands at each place, and how
    many others, false positives at every threshold, stand above it.
    """
    values = np.zeros(len(order))
    order, plain = np.ascontiguousarray(order, np.int32), np.ascontiguousarray(plain, np.int32)
    call(
        "lw_ordered", is_true, is_ignored, len(is_true), order, plain, len(order),
        ctypes.c_int32(n_truths), RECALL_THRESHOLDS, ctypes.c_int32(len(RECALL_THRESHOLDS)),
        ctypes.c_int32(N_THRESHOLDS), values,
    )  # fmt: skip
    return values
