"""Boxes and masks as a family of evaluations: scored from files, in memory, and checked again."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, cast

import numpy as np

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.errors import UsageError
from legoworld.evaluation.checks import Check, check_equal
from legoworld.evaluation.detection.amodal_sums import amodal_tables, amodal_values, total_sums
from legoworld.evaluation.detection.evaluate import default_evaluator, evaluate_detections
from legoworld.evaluation.detection.evaluators import run_evaluator
from legoworld.evaluation.detection.inputs.box_formats import check_box_values
from legoworld.evaluation.detection.inputs.prediction_checks import as_predictions
from legoworld.evaluation.detection.inputs.prediction_columns import make_columns, score_column
from legoworld.evaluation.detection.inputs.prediction_order import in_order
from legoworld.evaluation.detection.inputs.predictions import (
    check_results,
    hash_entries,
    prediction_type,
)
from legoworld.evaluation.detection.inputs.truth import Truth, read_truth, select_images
from legoworld.evaluation.detection.matching import outcomes
from legoworld.evaluation.detection.matching.matched_metrics import matched_document
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.accumulation import accumulate, metric_value
from legoworld.evaluation.detection.scoring import AGREEMENT, named_metrics
from legoworld.evaluation.detection.text import (
    detection_metrics,
    evaluator_lines,
    notes,
    short_detections,
)
from legoworld.evaluation.family import (
    EvaluationFamily,
    LiveAnswers,
    LiveFamily,
    LiveTruth,
    RecordedEvaluation,
    Scores,
)
from legoworld.records.base import as_json, decode
from legoworld.records.coco_file import TruthCategories
from legoworld.records.detection import DetectionEvidence, DetectionRow, DetectionSummary
from legoworld.records.folders.read_evaluation import MATCHES, VIEW
from legoworld.records.predictions import Prediction


def detection_checks(
    folder: Path, evidence: DetectionEvidence, summary: DetectionSummary
) -> Iterator[Check]:
    """The evaluator's raw numbers against those that follow from matches.npz, and the exports."""
    protocol = detection_protocol(summary.task)
    with np.load(folder / MATCHES) as stored:
        arrays = dict(stored)
    truth = decode(TruthCategories, (folder / VIEW / "truth.json").read_bytes())
    letters = {c.id: c.frequency or "" for c in truth.categories}
    frequencies = np.array([letters[int(i)] for i in arrays["category_ids"]])
    raw = evidence.raw.official, evidence.equal_confidence.official
    shown = summary.official, summary.equal_confidence.official
    for policy, name, official, again in zip(
        (outcomes.OWN, outcomes.EQUAL),
        ("own scores", "equal confidence"),
        raw,
        shown,
        strict=True,
    ):
        curves = accumulate(outcomes.table_from(arrays, policy), protocol)
        ours = np.array([metric_value(m, curves, frequencies) for m in protocol.metrics])
        worst = float(np.abs(ours - official).max())
        status = "ok" if worst <= AGREEMENT else "DIFFERS"
        yield Check(status, f"metrics from matches, {name}", f"largest difference {worst:.1e}")
        yield check_equal(f"summary against raw metrics, {name}", list(again), list(official))
    for kind, aware in (("class_aware", True), ("class_agnostic", False)):
        counts = outcomes.counts_from(arrays, class_aware=aware)
        document = as_json(matched_document(counts, class_aware=aware))
        yield check_equal(f"matched IoU, {kind}", document, as_json(getattr(summary.matched, kind)))
    predictions = decode(list[Prediction], (folder / VIEW / "predictions.json").read_bytes())
    recorded = evidence.raw.canonical_predictions_sha256
    yield check_equal("predictions", _export_sha256(predictions, equal=False), recorded)
    recorded = evidence.equal_confidence.predictions_sha256
    yield check_equal("equal-confidence export", _export_sha256(predictions, equal=True), recorded)


def _export_sha256(predictions: list[Prediction], *, equal: bool) -> str:
    """Hash of the results that view/predictions.json shows, as `Predictions.sha256` makes it."""
    entries = make_columns(predictions)
    if equal:
        entries = replace(entries, score=score_column([EQUAL_CONFIDENCE] * len(entries)))
        entries = in_order(entries, "canonical")
    return hash_entries(entries)


def _open(task: str, truth: LiveTruth) -> Truth:
    if not isinstance(truth, str | Path):
        raise UsageError(
            "boxes and masks are scored against a file",
            found=type(truth).__name__,
            expected="the dataset's own annotations, COCO or LVIS JSON",
        )
    return read_truth(Path(truth), detection_protocol(task))


def _score(
    task: str, truth: Truth, results: LiveAnswers, image_ids: Collection[int] | None
) -> Scores:
    """results: predictions as in a results file, in which equal confidences keep their order."""
    protocol = detection_protocol(task)
    if isinstance(results, Mapping):
        raise UsageError("boxes and masks are scored as results", found="arrays by image id")
    of_images = truth if image_ids is None else select_images(truth, image_ids)
    entries = as_predictions(results, prediction_type(protocol))
    sizes_wh = of_images.sizes_wh
    predictions = check_results(
        [entries],
        status_by_image=dict.fromkeys(sizes_wh, "ok"),
        sizes_wh=sizes_wh,
        vocabulary=truth.vocabulary,
        protocol=protocol,
        order="given",
        check_boxes=check_box_values,
    )
    kind = default_evaluator(protocol, lambda _text: None)
    scores = run_evaluator(of_images, predictions, protocol, kind)
    return Scores(
        task=task,
        evaluator=f"{scores.name} {scores.version}",
        n_images=len(sizes_wh),
        metrics=named_metrics(protocol, scores.official),
    )


LIVE: Final = LiveFamily(open=_open, sizes_wh=lambda truth: truth.sizes_wh, score=_score)


def _verify(recorded: RecordedEvaluation) -> Iterator[Check]:
    evidence = cast("DetectionEvidence", recorded.evidence)
    summary = cast("DetectionSummary", recorded.summary)
    yield from detection_checks(recorded.folder, evidence, summary)
    if summary.amodal and summary.amodal.sums:
        sums = [row.amodal for row in cast("list[DetectionRow]", recorded.rows) if row.amodal]
        yield check_equal("amodal sums", as_json(total_sums(sums)), as_json(summary.amodal.sums))
        yield check_equal("amodal metrics", amodal_values(sums), summary.amodal.metrics)


EVALUATION: Final = EvaluationFamily(
    evaluate=evaluate_detections,
    verify=_verify,
    short=short_detections,
    metrics=detection_metrics,
    head=evaluator_lines,
    notes=notes,
    tables=amodal_tables,
    files=frozenset({MATCHES}),
    live=LIVE,
)
