"""What the page scores a selection of photos with: every outcome, as the evaluator matched it."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from typing import Any, Final

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

#: From which confidences on predictions can be counted, and the first choice among them.
CONFIDENCES: Final = tuple(k / 20 for k in range(21))
USUAL_CONFIDENCE: Final = CONFIDENCES[6]


def cohorts(sides: Sequence[StoredEvaluation]) -> Cohorts:
    """The outcomes of every side of a section, with the photos and categories they are of."""
    truth = sides[0].truth_view()
    grid = detection_protocol(sides[0].task).grid
    images = sorted(truth.images, key=lambda i: i.id)
    return Cohorts(
        areas=grid.areas,
        half=grid.half,
        thresholds=len(grid.iou),
        confidences=CONFIDENCES,
        usual=USUAL_CONFIDENCE,
        categories=tuple((c.id, c.name) for c in sorted(truth.categories, key=lambda c: c.id)),
        images=tuple((i.id, i.width, i.height) for i in images),
        sides=tuple(_matched(side) for side in sides),
    )


def cohort_of_image(cohorts: Cohorts, image_id: int) -> Cohorts:
    """The part of one image, so that its predictions can be counted by confidence."""
    at = next(k for k, (image, _, _) in enumerate(cohorts.images) if image == image_id)
    return replace(
        cohorts,
        images=(cohorts.images[at],),
        sides=tuple(_of_image(s, at, cohorts) for s in cohorts.sides),
    )


def _of_image(side: MatchedSide, at: int, cohorts: Cohorts) -> MatchedSide:
    n_areas, above = len(cohorts.areas), np.array(side.above)
    mine, truths = _numbers(side.image) == at, _numbers(side.truth_image) == at
    before, start = np.append(0, np.cumsum(mine)), np.cumsum(above[0]) - above[0]
    rows, outcome = np.unique(_numbers(side.outcome)[mine], return_inverse=True)
    outcomes = _numbers(side.outcomes).reshape(-1, n_areas * cohorts.thresholds)
    return MatchedSide(
        ranked=side.ranked,
        above=_rows(before[start + above] - before[start]),
        image=_column(np.zeros_like(outcome)),
        outcome=_column(outcome),
        outcomes=_column(outcomes[rows]),
        truth_image=_column(np.zeros(np.count_nonzero(truths), np.int64)),
        truth_category=_column(_numbers(side.truth_category)[truths]),
        n_truths=_column(_numbers(side.n_truths).reshape(n_areas, -1)[:, truths]),
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
    first = outcome = np.zeros(len(table.image), np.int64)
    for area in table.state:
        code = outcome * 4 ** len(area) + 4 ** np.arange(len(area)) @ area
        _, first, outcome = np.unique(code, return_index=True, return_inverse=True)
    levels, n = (-np.inf, *CONFIDENCES), len(table.category_ids)
    above = [np.bincount(table.category[table.score >= s], minlength=n) for s in levels]
    return MatchedSide(
        ranked=is_ranked(side),
        above=_rows(above),
        image=_column(table.image),
        outcome=_column(outcome),
        outcomes=_column(table.state[:, :, first].transpose(2, 0, 1)),
        truth_image=_column(table.truth_image),
        truth_category=_column(table.truth_category),
        n_truths=_column(table.n_truths),
    )


def _rows(counts: Iterable[NDArray[np.int64]]) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(row.tolist()) for row in counts)


def _column(values: NDArray[Any]) -> str:
    """Whole numbers as text: how many bytes each has, and these, little-endian, in base64."""
    width = next(w for w in (1, 2, 4) if values.max(initial=0) < 256**w)
    return f"{width}{base64.b64encode(values.astype(f'<u{width}').tobytes()).decode('ascii')}"


def _numbers(column: str) -> NDArray[Any]:
    return np.frombuffer(base64.b64decode(column[1:]), f"<u{column[0]}")
