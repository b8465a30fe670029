"""Scores of amodal masks: by occlusion, what AP hides, and the controls they must beat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from legoworld.evaluation.bootstrap import interval, resample_counts
from legoworld.evaluation.detection.amodal_sums import (
    amodal_masks,
    amodal_metrics,
    amodal_values,
    image_sums,
    total_sums,
    true_masks,
)
from legoworld.evaluation.detection.evaluators import run_evaluator
from legoworld.evaluation.detection.grid import PICTURE
from legoworld.evaluation.detection.inputs.masks import (
    EncodedMask,
    TextBuilder,
    Texts,
    compress_mask,
    from_pixels,
    to_pixels,
)
from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.matching.matches import match_and_pair
from legoworld.evaluation.detection.payloads.masks import as_lists
from legoworld.evaluation.detection.problem import build_problem
from legoworld.evaluation.detection.scoring import Notice, Score, ScoreRequest, named_metrics
from legoworld.records.detection import AmodalNumbers, AmodalSums, OcclusionLevel
from legoworld.records.evaluation import Interval, Values

LEVELS: Final = ("none", "partial", "heavy")
_SHOWN: Final = ("AP", "AP50", "AP75", "AR100")
#: An area outside of every range: COCOeval ignores the truth, and what is matched to it.
_OUTSIDE: Final = 2 * PICTURE.ranges[0][1]


def score_amodal(
    request: ScoreRequest, predictions: Predictions, own: Score, notice: Notice
) -> tuple[AmodalNumbers, dict[str, Interval], list[AmodalSums]]:
    """The scores of amodal masks besides `own`: of the summary, its intervals, and of each image.

    Without visible masks there are only levels of occlusion.
    """
    true = true_masks(request.truth)
    masks = amodal_masks(true)
    of_truth = list(map(occlusion_level, masks.amodal_px.tolist(), masks.visible_px.tolist()))
    levels = {}
    for level in LEVELS:
        notice(f"truths of which others hide: {level}")
        levels[level] = _score_level(request, predictions, [mine == level for mine in of_truth])
    if predictions.entries.visible is None:
        return AmodalNumbers(metrics={}, levels=levels, controls={}), {}, []
    notice("invisible parts and order")
    sums = list(image_sums(own.problem, predictions, own.pairs_aware, true))
    controls = {}
    for name, texts in (
        ("visible_mask", predictions.entries.visible),
        ("convex_hull", _convex_hulls(predictions)),
    ):
        notice(f"control: amodal masks replaced by {name}")
        entries = replace(predictions.entries, shape=texts)
        controls[name] = _score_control(request, replace(predictions, entries=entries), true)
    drawn = amodal_metrics(sums, resample_counts(len(sums), request.draws, request.seed))
    intervals = {f"amodal.{k}": interval(v, unit="image") for k, v in drawn.items()}
    numbers = AmodalNumbers(
        metrics=amodal_values(sums), sums=total_sums(sums), levels=levels, controls=controls
    )
    return numbers, intervals, sums


def occlusion_level(amodal_px: float, visible_px: float) -> str:
    """none, partial (0, 1/4] or heavy (1/4, 1] of it hidden."""
    hidden = amodal_px - visible_px
    return "none" if hidden <= 0 else "partial" if 4 * hidden <= amodal_px else "heavy"


def _score_level(
    request: ScoreRequest, predictions: Predictions, included: Sequence[bool]
) -> OcclusionLevel:
    """The evaluator's numbers where the other truths are ignored."""
    given = list(zip(request.truth.annotations, included, strict=True))
    annotations = tuple(a if yes else {**a, "area": _OUTSIDE} for a, yes in given)
    return OcclusionLevel(
        truth_instances=sum(yes and not a["iscrowd"] for a, yes in given),
        metrics=_run_evaluator(
            request, replace(request.truth, annotations=annotations), predictions
        ),
    )


def _run_evaluator(request: ScoreRequest, truth: Truth, predictions: Predictions) -> Values:
    scores = run_evaluator(truth, predictions, request.protocol, request.kind)
    metrics = named_metrics(request.protocol, scores.official)
    return {name: metrics[name] for name in _SHOWN}


def _score_control(
    request: ScoreRequest, predictions: Predictions, true: Sequence[tuple[EncodedMask, EncodedMask]]
) -> Values:
    problem = build_problem(request.truth, predictions, request.protocol)
    pairs = match_and_pair(problem, request.truth, predictions, request.pool).aware
    sums = list(image_sums(problem, predictions, pairs, true))
    return {**_run_evaluator(request, request.truth, predictions), **amodal_values(sums)}


def _convex_hulls(predictions: Predictions) -> Texts:
    """The pixels inside of the convex hull of each visible mask's pixel centres."""
    import cv2

    hulls = TextBuilder()
    for entry in predictions.entries:
        assert entry.visible_mask
        seen = to_pixels(compress_mask(as_lists(entry.visible_mask), entry.visible_mask.size))
        hull, columns = np.zeros_like(seen), np.flatnonzero(seen.any(axis=0))
        if len(columns):  # the ends of each column have the hull of all pixels
            ends = seen.argmax(axis=0), len(seen) - 1 - seen[::-1].argmax(axis=0)
            points = [np.stack([columns, end[columns]], axis=1) for end in ends]
            corners = cv2.convexHull(np.concatenate(points).astype(np.int32))
            cv2.fillConvexPoly(hull, corners, [1])
        hulls.add([from_pixels(hull)["counts"].decode("ascii")])
    return hulls.texts()
