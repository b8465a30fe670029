"""The summary of an evaluation of normals: all pixels pooled, and means over images."""

from __future__ import annotations

from collections.abc import Sequence

from legoworld.evaluation.normals.angles import pooled_metrics
from legoworld.evaluation.normals.protocol import ANGLES, HOLE_DEG, METRICS, NormalsProtocol
from legoworld.evaluation.pixels.family import Settings, metric_policies
from legoworld.evaluation.pixels.summary import common, covered, mean, with_missing
from legoworld.records.evaluation_summary import Coverage, Evaluator
from legoworld.records.normals import AllAttempted, NormalsRow, NormalsSummary, ScoredNormalsRow
from legoworld.records.pixels import Means


def summarise(
    rows: Sequence[NormalsRow],
    *,
    kind: str,
    partial: bool,
    protocol: NormalsProtocol,
    settings: Settings,
) -> NormalsSummary:
    """summary.json. rows: of every attempted image, ascending id."""
    scored = [row for row in rows if isinstance(row, ScoredNormalsRow)]
    return NormalsSummary(
        task=protocol.card.task,
        kind=kind,
        partial=partial,
        evaluator=Evaluator(name=protocol.evaluator, version=protocol.evaluator_version),
        protocol=protocol.choices(),
        coverage=Coverage(**covered(rows)),
        pooled=_pooled(scored),
        pooled_px=sum(row.n_valid for row in scored),
        predicted_px=sum(row.errors.n for row in scored),
        all_attempted=_all_attempted(rows),
        mean_hole_share=mean([row.hole_share for row in scored]),
        **common(rows, METRICS, settings),
    )


def _pooled(scored: Sequence[ScoredNormalsRow]) -> Means:
    found: Means = {}
    if scored:
        holes = sum(row.n_valid - row.errors.n for row in scored)
        for name, values in pooled_metrics([row.errors for row in scored], holes).items():
            found[name] = {**values}
        return found
    for name, policy in metric_policies(METRICS):
        found.setdefault(name, {})[policy] = None
    return found


def _all_attempted(rows: Sequence[NormalsRow]) -> AllAttempted:
    """Mean error over every image with ground truth; an unscored one counts with 90 degrees."""
    with_truth = [row for row in rows if row.has_truth]
    values = with_missing(with_truth, ANGLES[0], HOLE_DEG)
    return AllAttempted(
        mean_deg={policy: mean(values(policy)) for policy in METRICS[0].policies},
        images=len(with_truth),
        missing=sum(not row.has_score for row in with_truth),
        missing_deg=HOLE_DEG,
    )
