"""Matching and pairing of all images, chunk by chunk, by the workers of a pool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.matching.chunks import Chunk, Chunks
from legoworld.evaluation.detection.matching.compiled_matching import match_chunk_states, pair_chunk
from legoworld.evaluation.detection.matching.matched_metrics import Pairs
from legoworld.evaluation.detection.problem import Problem
from legoworld.workers.tasks import IN_PROCESS, WorkerPool, map_items


@dataclass(frozen=True, kw_only=True)
class Matches:
    """The outcome of the detections of a chunk or a whole problem.

    state: (A, T, D) as in MatchTable, in the columns' order; aware, agnostic: the score-free pairs
    within and across categories.
    """

    state: NDArray[np.uint8]
    aware: Pairs
    agnostic: Pairs


def match_chunk(chunk: Chunk) -> Matches:
    """Match and pair the images of a chunk."""
    overlaps = chunk.payload.overlaps(chunk)
    return Matches(
        state=match_chunk_states(chunk, overlaps),
        aware=pair_chunk(chunk, overlaps, class_aware=True),
        agnostic=pair_chunk(chunk, overlaps, class_aware=False),
    )


def match_chunk_by_score(chunk: Chunk) -> NDArray[np.uint8]:
    """The (A, T, D) state alone, which another ranking of the same predictions changes."""
    return match_chunk_states(chunk, chunk.payload.overlaps(chunk))


def match_and_pair(
    problem: Problem, truth: Truth, predictions: Predictions, pool: WorkerPool = IN_PROCESS
) -> Matches:
    """Match and pair every image of a problem, independent of pool and chunks."""
    chunks = Chunks(problem, truth, predictions)
    done = list(map_items(match_chunk, chunks, pool.for_work(worth_a_process=chunks.many)))
    return Matches(
        state=np.concatenate([m.state for m in done], axis=2),
        aware=_join_pairs([m.aware for m in done], chunks),
        agnostic=_join_pairs([m.agnostic for m in done], chunks),
    )


def match_states(
    problem: Problem, truth: Truth, predictions: Predictions, pool: WorkerPool = IN_PROCESS
) -> NDArray[np.uint8]:
    """The (A, T, D) state of every image of a problem, without the score-free pairs."""
    chunks = Chunks(problem, truth, predictions)
    pool = pool.for_work(worth_a_process=chunks.many)
    return np.concatenate(list(map_items(match_chunk_by_score, chunks, pool)), axis=2)


def _join_pairs(parts: list[Pairs], chunks: Chunks) -> Pairs:
    """The chunks' pairs, in positions of the whole problem's columns."""
    detections, truths = chunks.starts
    return Pairs(
        detection=np.concatenate(
            [p.detection + first for p, first in zip(parts, detections, strict=True)]
        ),
        truth=np.concatenate([p.truth + first for p, first in zip(parts, truths, strict=True)]),
        iou=np.concatenate([p.iou for p in parts]),
        counted=np.concatenate([p.counted for p in parts]),
    )
