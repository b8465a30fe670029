"""`legoworld evaluate` for boxes and masks: writes an evaluation folder."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from msgspec import structs

from legoworld.evaluation.detection import lvis_package
from legoworld.evaluation.detection.amodal_scores import score_amodal
from legoworld.evaluation.detection.evaluators import EvaluatorKind
from legoworld.evaluation.detection.inputs.predictions import (
    Predictions,
    check_predictions,
    prediction_type,
    with_equal_confidence,
)
from legoworld.evaluation.detection.inputs.truth import Truth, read_truth
from legoworld.evaluation.detection.matching import outcomes
from legoworld.evaluation.detection.matching.matched_metrics import matched_document
from legoworld.evaluation.detection.matching.outcomes import FALSE_POSITIVE
from legoworld.evaluation.detection.payloads.amodal import AMODAL
from legoworld.evaluation.detection.problem import Ints
from legoworld.evaluation.detection.protocols import DetectionProtocol, detection_protocol
from legoworld.evaluation.detection.rows import per_category_rows, per_image_rows, views
from legoworld.evaluation.detection.scoring import (
    Notice,
    RankedScore,
    Score,
    ScoreRequest,
    category_frequencies,
    named_metrics,
    ranked_score,
    score,
)
from legoworld.evaluation.family import EvaluationRequest, make_configuration, prepare_inputs
from legoworld.evaluation.run import Run, read_predictions, run_view
from legoworld.records.base import UNSET, UnsetType
from legoworld.records.detection import (
    AmodalSums,
    CardOrigin,
    Counts,
    DetectionConfiguration,
    DetectionCoverage,
    DetectionEvidence,
    DetectionSummary,
    EqualConfidence,
    EqualScores,
    FrequencyCounts,
    MatchedKinds,
    RawScores,
    RunOrigin,
    SpaceErrors,
    TruthCounts,
)
from legoworld.records.evaluation import Evaluator
from legoworld.records.folders.evaluation_folder import Evaluation, make_evidence, write_evaluation


def evaluate_detections(request: EvaluationRequest) -> DetectionSummary:
    """Score a coco or lvis run and write the evaluation folder; return its summary.

    The option evaluator: None for the official one where it is installed, else the fast one. Any
    pool gives the same bytes. Every LegoWorldError is raised before anything is written.
    """
    run, notice, draws = request.run, request.notice, request.draws
    protocol = detection_protocol(run.task)
    kind = request.options.get("evaluator") or default_evaluator(protocol, request.warn)
    truth = read_truth(request.truth, protocol, run)
    configuration = make_configuration(
        request, protocol.card, DetectionConfiguration, evaluator=kind
    )
    inputs = prepare_inputs(request, [("truth", request.truth), *run.inputs], configuration)
    notice("checking the predictions")
    batches = read_predictions(run, prediction_type(protocol))
    predictions = check_predictions(batches, run=run, truth=truth, protocol=protocol)
    scoring = ScoreRequest(
        truth=truth, protocol=protocol, kind=kind, draws=draws, seed=request.seed, pool=request.pool
    )
    own = score(scoring, predictions, notice)
    equal = None
    if not predictions.equally_confident:
        notice("the same predictions under equal confidence")
        equal = ranked_score(scoring, _kept_equal(predictions, own), notice)
    summary = _summary(run, scoring, predictions, own, equal)
    sums: list[AmodalSums] = []
    if protocol.payload is AMODAL:
        amodal, intervals, sums = score_amodal(scoring, predictions, own, notice)
        intervals = {**summary.intervals, **intervals}
        summary = structs.replace(summary, amodal=amodal, intervals=intervals)
    evaluation = Evaluation(
        summary=summary,
        evidence=_evidence(configuration, summary, run, protocol, predictions, own),
        inputs=inputs,
        per_image=per_image_rows(run, predictions, own, sums),
        per_category=per_category_rows(truth, own),
        matches=outcomes.pack_matches(own, equal),
        view={**views(truth, predictions, own), "run.json": run_view(run)},
    )
    write_evaluation(request.output, evaluation, overwrite=request.overwrite)
    return summary


def default_evaluator(protocol: DetectionProtocol, warn: Notice) -> EvaluatorKind:
    """The official evaluator, or hotcoco with a warning if lvis is not installed."""
    if protocol.federated and not lvis_package.is_installed():
        warn(
            "the official LVIS evaluator is not installed: scoring with hotcoco, whose numbers "
            f"agree to 1e-12; for the official one: {lvis_package.HOW_TO_INSTALL}"
        )
        return "fast"
    return "official"


def _kept_equal(predictions: Predictions, own: Score) -> Predictions:
    """The predictions kept by the cap under their own scores, with equal scores."""
    kept = np.sort(own.problem.detections.entry)
    return with_equal_confidence(replace(predictions, entries=predictions.entries.take(kept)))


def _summary(
    run: Run, request: ScoreRequest, predictions: Predictions, own: Score, equal: RankedScore | None
) -> DetectionSummary:
    truth, protocol = request.truth, request.protocol
    policy = equal or own
    return DetectionSummary(
        task=protocol.task,
        kind=run.configuration.kind or None,
        partial=run.partial,
        dataset_version=truth.version,
        evaluator=Evaluator(name=own.scores.name, version=own.scores.version),
        iou_type=protocol.iou_type,
        coverage=_coverage(run, own),
        metrics=named_metrics(protocol, own.scores.official),
        official=own.scores.official,
        ties=own.ties,
        equal_confidence=EqualConfidence(
            already_equal=equal is None,
            metrics=named_metrics(protocol, policy.scores.official),
            official=policy.scores.official,
            ties=policy.ties,
        ),
        matched=MatchedKinds(
            class_aware=matched_document(own.aware, class_aware=True),
            class_agnostic=matched_document(own.agnostic, class_aware=False),
        ),
        intervals=own.intervals,
        counts=_counts(truth, protocol, predictions, own),
        warnings=(*truth.warnings, *predictions.warnings),
        in_space=_pair_errors(truth, protocol, predictions, own),
    )


def _pair_errors(
    truth: Truth, protocol: DetectionProtocol, predictions: Predictions, own: Score
) -> SpaceErrors | UnsetType:
    measure, pairs, problem = protocol.payload.pair_errors, own.pairs_aware, own.problem
    if measure is None:
        return UNSET
    entries = problem.detections.entry[pairs.detection].tolist()
    annotations = problem.truths.annotation[pairs.truth].tolist()
    true = [truth.annotations[k][protocol.payload.field] for k in annotations]
    return measure([predictions.entries.shape[k] for k in entries], true)


def _coverage(run: Run, own: Score) -> DetectionCoverage:
    """Every denominator: images attempted, scored, with truth, and both."""
    n_truth = own.aware.per_image[:, 0]
    scored = np.array([i.status == "ok" for i in run.images])
    with_predictions = set(own.problem.image_ids[own.problem.detections.image].tolist())
    return DetectionCoverage(
        attempted=len(run.images),
        scored=int(scored.sum()),
        with_truth=int((n_truth > 0).sum()),
        scored_with_truth=int((scored & (n_truth > 0)).sum()),
        scored_without_predictions=sum(
            i.status == "ok" and i.image_id not in with_predictions for i in run.images
        ),
        by_status=dict(sorted(Counter(i.status for i in run.images).items())),
    )


def _counts(
    truth: Truth, protocol: DetectionProtocol, predictions: Predictions, own: Score
) -> Counts:
    table, problem = own.table, own.problem
    by_area = table.truths_per_category
    n_truths = by_area[0]
    false = table.state[0, protocol.grid.half] == FALSE_POSITIVE
    return Counts(
        categories=len(table.category_ids),
        categories_with_truth=int((n_truths > 0).sum()),
        truth_instances=int(n_truths.sum()),
        truth_ignored=int(problem.truths.ignored.sum()),
        predictions=len(predictions.entries),
        empty_masks_dropped=predictions.n_dropped_empty,
        lost_to_cap=problem.n_over_cap,
        unverified_dropped=problem.n_unverified,
        false_positives_in_absent_categories=int((false & (n_truths[table.category] == 0)).sum()),
        areas={
            area: TruthCounts(
                categories_with_truth=int((by_area[a] > 0).sum()),
                truth_instances=int(by_area[a].sum()),
            )
            for a, area in enumerate(protocol.grid.areas)
        },
        frequency_groups=_frequency_groups(truth, n_truths) if protocol.federated else UNSET,
    )


def _frequency_groups(truth: Truth, n_truths: Ints) -> dict[str, FrequencyCounts]:
    frequencies = category_frequencies(truth)
    return {
        letter: FrequencyCounts(
            categories=int((frequencies == letter).sum()),
            categories_with_truth=int(((frequencies == letter) & (n_truths > 0)).sum()),
            truth_instances=int(n_truths[frequencies == letter].sum()),
        )
        for letter in "rcf"
    }


def _evidence(
    configuration: DetectionConfiguration,
    summary: DetectionSummary,
    run: Run,
    protocol: DetectionProtocol,
    predictions: Predictions,
    own: Score,
) -> DetectionEvidence:
    """The raw numbers and the exports they belong to."""
    made = run.configuration
    return make_evidence(
        DetectionEvidence,
        summary,
        configuration,
        run=RunOrigin(
            **{name: getattr(made, name) or None for name in RunOrigin.__struct_fields__}
        ),
        protocol=CardOrigin(
            task=protocol.task, card_version=protocol.card.version, card_sha256=protocol.card.sha256
        ),
        raw=RawScores(
            official=own.scores.official,
            lines=own.scores.lines,
            prediction_order=predictions.order,
            canonical_predictions_sha256=predictions.sha256,
        ),
        equal_confidence=EqualScores(
            official=summary.equal_confidence.official,
            predictions_sha256=predictions.sha256_equally_confident,
        ),
    )
