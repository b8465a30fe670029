"""Re-checking a detection evaluation: its numbers from its matches, and its exports."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.evaluation.checks import Check, check_equal
from legoworld.evaluation.detection.inputs.prediction_columns import make_columns, score_column
from legoworld.evaluation.detection.inputs.prediction_order import in_order
from legoworld.evaluation.detection.inputs.predictions import sha256_of_entries
from legoworld.evaluation.detection.matching import matches_file
from legoworld.evaluation.detection.matching.matched_metrics import matched_document
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.accumulation import accumulate, metric_value
from legoworld.evaluation.detection.scoring import AGREEMENT
from legoworld.records.base import as_json, decode
from legoworld.records.detection import DetectionEvidence
from legoworld.records.evaluation_summary import DetectionSummary
from legoworld.records.evaluation_view import TruthCategories
from legoworld.records.folders.read_evaluation import (
    MATCHES,
    VIEW,
)
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
        (matches_file.OWN, matches_file.EQUAL),
        ("own scores", "equal confidence"),
        raw,
        shown,
        strict=True,
    ):
        curves = accumulate(matches_file.table_from(arrays, policy), protocol)
        ours = np.array([metric_value(m, curves, frequencies) for m in protocol.metrics])
        worst = float(np.abs(ours - official).max())
        status = "ok" if worst <= AGREEMENT else "DIFFERS"
        yield Check(status, f"metrics from matches, {name}", f"largest difference {worst:.1e}")
        yield check_equal(f"summary against raw metrics, {name}", list(again), list(official))
    for kind, aware in (("class_aware", True), ("class_agnostic", False)):
        counts = matches_file.counts_from(arrays, class_aware=aware)
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
    return sha256_of_entries(entries)
