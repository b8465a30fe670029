"""A bench evaluation's rows as its summary."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from legoworld.evaluation.bootstrap import LEVEL, draw_groups
from legoworld.evaluation.reconstruction.articulation import (
    articulation_rules,
    articulation_score,
    sum_counts,
)
from legoworld.evaluation.reconstruction.integrity import FlagThresholds, view_drop
from legoworld.evaluation.reconstruction.means import (
    compute_group_means,
    compute_means,
    diagnostic_means,
    headline,
)
from legoworld.evaluation.reconstruction.protocol import BenchProtocol, Choices
from legoworld.records.base import UNSET, UnsetType, as_json, to_record
from legoworld.records.bench_dataset import ArticulationSummary
from legoworld.records.evaluation import Evaluator, NotScored
from legoworld.records.reconstruction import (
    COMPARED,
    CaseFlag,
    FamilyBootstrap,
    Flag,
    NoiseSummary,
    ReconstructionCoverage,
    ReconstructionRow,
    ReconstructionRules,
    ReconstructionSummary,
)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The command line's choices, and whether every reference was sampled at the raster."""

    choices: Choices
    sampled: bool
    draws: int
    seed: int


def summarise(
    rows: Sequence[ReconstructionRow],
    *,
    kind: str,
    partial: bool,
    protocol: BenchProtocol,
    settings: Settings,
) -> ReconstructionSummary:
    """The summary of the rows of every attempted case, ascending image id."""
    measures = headline([t.name for t in protocol.others], second=protocol.x is not None)
    draws = draw_groups([row.family for row in rows], settings.draws, settings.seed)
    return ReconstructionSummary(
        task=protocol.card.task,
        kind=kind,
        partial=partial,
        evaluator=Evaluator(name=protocol.evaluator, version=protocol.evaluator_version),
        coverage=ReconstructionCoverage(
            attempted=len(rows),
            scored=sum(row.status == COMPARED for row in rows),
            with_truth=len(rows),
            by_status=dict(sorted(Counter(row.status for row in rows).items())),
            valid=sum(row.valid for row in rows),
        ),
        protocol=_rules(protocol, settings),
        metrics=compute_means(measures, rows, draws),
        diagnostics=diagnostic_means(rows),
        groups=compute_group_means(measures, rows, settings.draws, settings.seed),
        bootstrap=FamilyBootstrap(
            draws=settings.draws,
            seed=settings.seed,
            unit="family",
            groups=len(draws.column),
            level=LEVEL,
        ),
        noise=_noise(rows),
        flags=tuple(_flags(rows, protocol.flags)),
        not_scored=tuple(_not_scored(row) for row in rows if not row.valid),
        warnings=sum(len(row.warnings) for row in rows),
        articulation=_articulation(rows),
    )


def _articulation(rows: Sequence[ReconstructionRow]) -> ArticulationSummary | UnsetType:
    """The pilot over the cases that have scored joints; UNSET where none has."""
    articulations = [row.articulation for row in rows if row.articulation is not UNSET]
    some = [one for one in articulations if any(j.outcome != "ignored" for j in one.joints)]
    if not some:
        return UNSET
    counts, rules = sum_counts(some), articulation_rules()
    scores = [one.score for one in some if one.score is not None]
    return ArticulationSummary(
        **counts,
        score=articulation_score(**counts),
        cases=len(some),
        mean_score=float(np.mean(scores)) if scores else None,
        provisional=True,
        card_version=rules.version,
        card_sha256=rules.sha256,
    )


def _rules(protocol: BenchProtocol, settings: Settings) -> ReconstructionRules:
    values = protocol.card.value("scoring")
    points = settings.sampled and settings.choices.sampling == "raster"
    return to_record(
        ReconstructionRules,
        {
            **{name: values[name] for name in ("tolerance", "tolerances", "tolerances_m", "delta")},
            "depth_limit_m": protocol.depth_limit_m,
            "reference_sampling": settings.choices.sampling,
            "reference_points": "raster" if points else "full_resolution_pixels",
            "diagnostics": settings.choices.diagnostics,
        },
    )


def _noise(rows: Sequence[ReconstructionRow]) -> NoiseSummary:
    noise = [row.appearance.noise for row in rows if row.appearance is not None]
    means = [n.reference_mean for n in noise if n.reference_mean is not None]
    sds = [n.reference_sd for n in noise if n.reference_sd is not None]
    pairs = [n.two_seeds for n in noise if n.two_seeds is not None]
    return NoiseSummary(
        reference_mean=float(np.mean(means)) if means else None,
        reference_sd=float(np.mean(sds)) if sds else None,
        n_reference=len(means),
        two_seeds=float(np.mean(pairs)) if pairs else None,
        n_two_seeds=len(pairs),
    )


def _not_scored(row: ReconstructionRow) -> NotScored:
    status, reason = row.status, row.reason
    if status == COMPARED:
        failed = {name: c.found for name, c in (row.validity or {}).items() if not c.ok}
        status, reason = "not_valid", "; ".join(c or name for name, c in failed.items()) or None
    return NotScored(image_id=row.image_id, file_name=row.file_name, status=status, reason=reason)


def _flags(rows: Sequence[ReconstructionRow], thresholds: FlagThresholds) -> list[CaseFlag]:
    """Each case's own, then views of a family and tier whose A falls from the first one's."""
    flags = [_case_flag(row, flag) for row in rows for flag in row.flags]
    first: dict[tuple[str, str | None], ReconstructionRow] = {}
    for row in sorted(rows, key=lambda row: row.view):
        if not row.valid or row.A is None:
            continue
        before = first.setdefault((row.family, row.tier), row)
        if before is not row and before.A is not None:
            drop = view_drop(before.A, row.A, thresholds)
            flags += [_case_flag(row, drop)] if drop else []
    return sorted(flags, key=lambda flag: (flag.image_id, flag.kind, flag.what))


def _case_flag(row: ReconstructionRow, flag: Flag) -> CaseFlag:
    return CaseFlag(image_id=row.image_id, file_name=row.file_name, **as_json(flag))
