"""What the page scores a selection of photos with: every outcome, as the evaluator matched it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from legoworld.evaluation.detection.matching.outcomes import (
    FALSE_POSITIVE,
    TRUE_POSITIVE,
    table_from,
)
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.accumulation import precision_at_recalls
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.report_tables import Cohorts, MatchedSide

#: Two bits a state, four states a byte.
_A_BYTE = 4


def cohorts(sides: Sequence[StoredEvaluation]) -> Cohorts:
    """The outcomes of every side of a section, with the photos and categories they are of."""
    truth = sides[0].truth_view()
    grid = detection_protocol(sides[0].task).grid
    images = sorted(truth.images, key=lambda i: i.id)
    return Cohorts(
        areas=grid.areas,
        half=grid.half,
        thresholds=len(grid.iou),
        categories=tuple((c.id, c.name) for c in sorted(truth.categories, key=lambda c: c.id)),
        images=tuple((i.id, i.width, i.height) for i in images),
        sides=tuple(_matched(side) for side in sides),
    )


def cohort_of_image(whole: Cohorts, image_id: int) -> Cohorts:
    """The part of one image, so that its predictions can be counted by confidence."""
    at = next(k for k, (image, _, _) in enumerate(whole.images) if image == image_id)
    return replace(
        whole, images=(whole.images[at],), sides=tuple(_of_image(s, at, whole) for s in whole.sides)
    )


def _of_image(side: MatchedSide, at: int, whole: Cohorts) -> MatchedSide:
    def read(text: str, kind: str, *shape: int) -> NDArray[Any]:
        return np.frombuffer(base64.b64decode(text), kind).reshape(shape)

    mine = read(side.image, "<u4", -1) == at
    truths = read(side.truth_image, "<u4", -1) == at
    n_bytes = -(-len(whole.areas) * whole.thresholds // _A_BYTE)
    return MatchedSide(
        ranked=side.ranked,
        image=_base64(np.zeros(np.count_nonzero(mine)), "<u4"),
        category=_base64(read(side.category, "<u4", -1)[mine], "<u4"),
        score=_base64(read(side.score, "<f4", -1)[mine], "<f4"),
        state=_base64(read(side.state, "u1", -1, n_bytes)[mine], "u1"),
        truth_image=_base64(np.zeros(np.count_nonzero(truths)), "<u4"),
        truth_category=_base64(read(side.truth_category, "<u4", -1)[truths], "<u4"),
        n_truths=_base64(read(side.n_truths, "<u4", len(whole.areas), -1)[:, truths], "<u4"),
    )


def is_ranked(side: StoredEvaluation) -> bool:
    """Whether a side's own scores order its predictions."""
    score = table_from(side.matches).score
    return len(score) > 0 and bool(score.min() < score.max())


def photo_gains(side: StoredEvaluation) -> dict[int, float]:
    """What AP at IoU 0.5 gains where one photo alone is perfect, by image id."""
    table, gains = table_from(side.matches), dict[int, float]()
    states = table.state[0, detection_protocol(side.task).grid.half]
    scored = np.flatnonzero(table.truths_per_category[0])
    for k in scored.tolist():
        rows, n = table.category_slices[k], int(table.truths_per_category[0, k])
        true = np.flatnonzero(states[rows] == TRUE_POSITIVE)
        # What is less sure than the last true positive changes no precision that is read.
        counted = slice(rows.start, rows.start + (int(true[-1]) + 1 if len(true) else 0))
        state, image = states[counted], table.image[counted]
        cells = np.flatnonzero(table.truth_category == k)
        owned = dict(
            zip(table.truth_image[cells].tolist(), table.n_truths[0, cells].tolist(), strict=True)
        )
        before = _ap(state, n)
        for at in {*owned, *image[state == FALSE_POSITIVE].tolist()}:
            found = np.full(owned.get(at, 0), TRUE_POSITIVE, state.dtype)
            after = _ap(np.concatenate([found, state[image != at]]), n)
            name = int(table.image_ids[at])
            gains[name] = gains.get(name, 0.0) + (after - before) / len(scored)
    return gains


def _ap(state: NDArray[np.uint8], n_truths: int) -> float:
    true, false = state == TRUE_POSITIVE, state == FALSE_POSITIVE
    return float(precision_at_recalls(true[None], false[None], n_truths).mean())


def _matched(side: StoredEvaluation) -> MatchedSide:
    table = table_from(side.matches)
    n_areas, n_thresholds, n = table.state.shape
    states = table.state.transpose(2, 0, 1).reshape(n, n_areas * n_thresholds)
    padded = np.pad(states, ((0, 0), (0, -states.shape[1] % _A_BYTE)))
    bits = padded.reshape(n, padded.shape[1] // _A_BYTE, _A_BYTE) << np.arange(
        0, 8, 2, dtype=np.uint8
    )
    return MatchedSide(
        ranked=is_ranked(side),
        image=_base64(table.image, "<u4"),
        category=_base64(table.category, "<u4"),
        score=_base64(table.score, "<f4"),
        state=_base64(bits.sum(axis=2), "u1"),
        truth_image=_base64(table.truth_image, "<u4"),
        truth_category=_base64(table.truth_category, "<u4"),
        n_truths=_base64(table.n_truths, "<u4"),
    )


def _base64(values: NDArray[Any], kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode("ascii")
