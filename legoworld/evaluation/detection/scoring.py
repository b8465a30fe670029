"""One set of predictions scored under one policy: evaluator, matches, ties, intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.evaluation.bootstrap import centred_interval, resample_counts
from legoworld.evaluation.detection.evaluators import (
    EvaluatorDisagreesError,
    EvaluatorKind,
    OfficialScores,
    run_evaluator,
)
from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.matching.matched_metrics import (
    MatchedCounts,
    Pairs,
    matched_counts,
    matched_metrics,
)
from legoworld.evaluation.detection.matching.matches import match_and_pair, match_states
from legoworld.evaluation.detection.matching.outcomes import MatchTable, match_table
from legoworld.evaluation.detection.problem import Problem, build_problem
from legoworld.evaluation.detection.protocols import DetectionProtocol
from legoworld.evaluation.detection.ranking.accumulation import Curves, accumulate, metric_value
from legoworld.evaluation.detection.ranking.resampling import (
    resampled_metrics,
    single_image_metrics,
)
from legoworld.evaluation.detection.ranking.ties import tie_orders
from legoworld.pluralize import plural
from legoworld.records.detection import Ties
from legoworld.records.evaluation import Interval, Values
from legoworld.workers.tasks import IN_PROCESS, WorkerPool

#: Largest difference between an evaluator's number and ours: summation order, nothing more.
AGREEMENT: Final = 1e-12

Notice = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class ScoreRequest:
    """What is scored and how; the pool does not affect results."""

    truth: Truth
    protocol: DetectionProtocol
    kind: EvaluatorKind
    draws: int
    seed: int
    pool: WorkerPool = IN_PROCESS


@dataclass(frozen=True, kw_only=True)
class RankedScore:
    """The results that depend on the ranking of predictions, one per confidence policy."""

    scores: OfficialScores
    problem: Problem
    table: MatchTable
    curves: Curves
    ties: Ties


@dataclass(frozen=True, kw_only=True)
class Score(RankedScore):
    """A ranked score with the score-free results, and the intervals of both.

    aware and agnostic: counts within and across categories.
    """

    pairs_aware: Pairs
    aware: MatchedCounts
    agnostic: MatchedCounts
    intervals: dict[str, Interval]


def category_frequencies(truth: Truth) -> NDArray[np.str_]:
    """(K,) LVIS's frequency letter of each category; empty where there is none."""
    by_id = {c["id"]: str(c.get("frequency", "")) for c in truth.categories}
    return np.array([by_id[c.id] for c in truth.vocabulary.categories])


def score(request: ScoreRequest, predictions: Predictions, notice: Notice) -> Score:
    """Score predictions. EvaluatorDisagreesError if evaluator and matches disagree."""
    problem = build_problem(request.truth, predictions, request.protocol)
    notice(_said_matching(problem))
    matches = match_and_pair(problem, request.truth, predictions, request.pool)
    ranked = _score_ranking(request, predictions, problem, matches.state, notice)
    counts = matched_counts(problem, matches.aware), matched_counts(problem, matches.agnostic)
    notice(f"{request.draws} bootstrap samples")
    samples = resample_counts(len(problem.image_ids), request.draws, request.seed)
    return Score(
        **{f.name: getattr(ranked, f.name) for f in fields(ranked)},
        pairs_aware=matches.aware,
        aware=counts[0],
        agnostic=counts[1],
        intervals=_intervals(request, ranked.scores, ranked.table, *counts, samples),
    )


def _said_matching(problem: Problem) -> str:
    """What is about to be done. LegoWorldError where it is too much for an image."""
    most, n = problem.protocol.payload.most_pairs, len(problem.image_ids)
    if most is None:
        return "matching"
    pairs = np.bincount(problem.detections.image, minlength=n) * np.bincount(
        problem.truths.image, minlength=n
    )
    if pairs.max(initial=0) > most:
        raise LegoWorldError(
            f"image {problem.image_ids[pairs.argmax()]} has too many boxes to compare",
            found=f"{pairs.max():,} pairs of predictions and annotations",
            expected=f"at most {most:,}",
            next_step="leave out what is not a thing to be found, or divide the photo",
        )
    return f"matching {plural(int(pairs.sum()), 'pair', 'pairs')}"


def ranked_score(request: ScoreRequest, predictions: Predictions, notice: Notice) -> RankedScore:
    """Score the same predictions under another ranking, without the score-free results."""
    problem = build_problem(request.truth, predictions, request.protocol)
    notice("matching")
    state = match_states(problem, request.truth, predictions, request.pool)
    return _score_ranking(request, predictions, problem, state, notice)


def _score_ranking(
    request: ScoreRequest,
    predictions: Predictions,
    problem: Problem,
    state: NDArray[np.uint8],
    notice: Notice,
) -> RankedScore:
    table = match_table(problem, state)
    curves = accumulate(table, request.protocol)
    notice("running the evaluator")
    scores = run_evaluator(request.truth, predictions, request.protocol, request.kind)
    check_agreement(scores, curves, request.truth, request.protocol)
    notice(f"{request.draws} tie orders")
    ties = tie_orders(table, draws=request.draws, seed=request.seed)
    return RankedScore(scores=scores, problem=problem, table=table, curves=curves, ties=ties)


def check_agreement(
    scores: OfficialScores, curves: Curves, truth: Truth, protocol: DetectionProtocol
) -> None:
    """Compare an evaluator's numbers with those recomputed from the recorded matches.

    Raises EvaluatorDisagreesError where they differ.
    """
    frequencies = category_frequencies(truth)
    ours = np.array([metric_value(m, curves, frequencies) for m in protocol.metrics])
    theirs = np.array(scores.official)
    worst = float(np.abs(ours - theirs).max())
    precision = float(np.abs(curves.precision - scores.precision).max(initial=0.0))
    if not (worst <= AGREEMENT and precision <= AGREEMENT):  # NaN is no agreement
        raise EvaluatorDisagreesError(
            f"{scores.name} {scores.version} disagrees with the recorded matches",
            found=f"metrics differ by {worst:.3g}, precision by {precision:.3g}",
            expected=f"at most {AGREEMENT:g}",
            next_step="this is a bug: report it with the run and the truth; no number was written",
        )


def _intervals(
    request: ScoreRequest,
    scores: OfficialScores,
    table: MatchTable,
    aware: MatchedCounts,
    agnostic: MatchedCounts,
    samples: NDArray[np.int32],
) -> dict[str, Interval]:
    """Bootstrap intervals over images of every official and every score-free number."""
    protocol = request.protocol
    metrics = resampled_metrics(table, protocol, samples, category_frequencies(request.truth))
    values = dict(zip((m.name for m in protocol.metrics), scores.official, strict=True))
    whole = np.ones((1, samples.shape[1]), np.int32)
    for prefix, counts in (("class_aware", aware), ("class_agnostic", agnostic)):
        resampled, point = matched_metrics(counts, samples), matched_metrics(counts, whole)
        for name in resampled:
            if not name.startswith("n_"):
                metrics[f"{prefix}.{name}"] = resampled[name]
                values[f"{prefix}.{name}"] = float(point[name][0])
    del metrics["class_aware.label_accuracy"]
    lone = single_image_metrics(table, protocol, category_frequencies(request.truth))
    if len(np.unique(table.truth_image)) < 2:
        lone = set(metrics)
    return {
        name: centred_interval(
            resampled, np.nan if name in lone else _nan_if_undefined(values[name]), unit="image"
        )
        for name, resampled in metrics.items()
    }


def _nan_if_undefined(value: float) -> float:
    """An official -1 is no value."""
    return float("nan") if value == -1 else value


def named_metrics(protocol: DetectionProtocol, official: tuple[float, ...]) -> Values:
    """The evaluator's numbers by name, None where undefined."""
    return {
        m.name: None if value == -1 or not np.isfinite(value) else float(value)
        for m, value in zip(protocol.metrics, official, strict=True)
    }
