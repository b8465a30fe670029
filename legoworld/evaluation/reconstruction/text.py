"""An evaluation of a bench as text: both averages, the noise, flags, and what counts 0."""

from __future__ import annotations

from typing import Final

from legoworld.evaluation.metrics import (
    MetricPart,
    MetricRow,
    bounds,
    describe_evaluator,
    first_few,
    fraction,
    number_cell,
)
from legoworld.evaluation.reconstruction.means import SECOND
from legoworld.pluralize import plural
from legoworld.records.reconstruction import (
    Group,
    Means,
    NoiseSummary,
    ReconstructionSummary,
)
from legoworld.tables.table import Cell, Number, Table, table

_SCORES: Final = ("V", "R", "A", "S")
_VALID: Final = ("R_valid", "A_valid", "S_valid")


def short_bench(summary: ReconstructionSummary) -> str:
    """V, R, A, S with both averages and their denominators, A's noise, flags, what counts 0."""
    lines = [_title(summary), *_averages(summary.metrics), *_noise(summary), *_joints(summary)]
    if summary.flags:
        cases = plural(len({flag.image_id for flag in summary.flags}), "case", "cases")
        lines.append(
            f"{plural(len(summary.flags), 'flag', 'flags')} in {cases}; no score was changed "
            "(-v lists all)"
        )
    few = first_few(_zeros(summary), "case that counts 0", "cases that count 0")
    return "\n".join([*lines, *few])


def _zeros(summary: ReconstructionSummary) -> list[str]:
    return [f"0: {r.status}: {r.file_name}: {r.reason}" for r in summary.not_scored]


def bench_metrics(summary: ReconstructionSummary) -> list[MetricPart]:
    """Every mean with its interval and denominator, and every diagnostic."""
    rules = summary.protocol
    parts = [
        MetricPart(
            title="Every metric",
            rows=_rows(summary.metrics),
            note=f"R is at {100 * rules.tolerance:g} % of the depth, A at {rules.delta} of 255.",
        ),
        MetricPart(title="Diagnostics, in no score", rows=_rows(summary.diagnostics)),
    ]
    return [part for part in parts if part.rows]


def group_tables(summary: ReconstructionSummary) -> list[Table]:
    """The scores by tier, split, environment and theme."""
    rows: list[tuple[Cell, ...]] = [
        (
            f"{kind} {name}",
            *(Number(value=group.metrics[m].value) for m in (*_SCORES, *_VALID)),
            _size(group),
        )
        for kind in ("tier", "split", "environment", "theme")
        for name, group in getattr(summary.groups, kind).items()
    ]
    return [table(("group", *_SCORES, *_VALID, "over"), rows)]


def bench_notes(summary: ReconstructionSummary) -> list[str]:
    """The noise of A, the pilot, integrity flags, and what counts 0."""
    lines = [*_noise(summary), *_joints(summary)]
    lines += [
        f"flag: {f.kind}: {f.file_name}: {f.what}: {f.measured:.3f} (from {f.threshold:g})"
        for f in summary.flags
    ]
    return [*lines, *_zeros(summary)]


def _title(summary: ReconstructionSummary) -> str:
    coverage, rules = summary.coverage, summary.protocol
    sampling = "" if rules.reference_sampling == "raster" else f", {rules.reference_sampling}"
    partial = "; partial run" if summary.partial else ""
    return (
        f"{describe_evaluator(summary)}, bench{sampling}: "
        f"{plural(coverage.attempted, 'case', 'cases')} attempted, {coverage.scored} compared, "
        f"{coverage.valid} valid; intervals over "
        f"{plural(summary.bootstrap.groups, 'family', 'families')}{partial}"
    )


def _averages(metrics: Means) -> list[str]:
    all_cases = (f"{m} {fraction(metrics[m].value)}{bounds(metrics[m].interval)}" for m in _SCORES)
    valid = (f"{m[0]} {fraction(metrics[m].value)}" for m in _VALID)
    return [
        f"over all {metrics['S'].n} attempted, zeros included: {', '.join(all_cases)}",
        f"over the {metrics['S_valid'].n} valid: {', '.join(valid)}",
        *_second_card(metrics),
    ]


def _second_card(metrics: Means) -> list[str]:
    """The second card's means, where the task has one."""
    known = [name for name in SECOND if name in metrics]
    numbers = ", ".join(f"{name} {fraction(metrics[name].value)}" for name in known)
    return [f"second card, in no score: {numbers}"] if known else []


def noise_floor(noise: NoiseSummary) -> str:
    """A of the references rendered by the card; empty where it was not measured."""
    if noise.reference_mean is None:
        return ""
    sd = f", sd {noise.reference_sd:.4f} between seeds" if noise.reference_sd else ""
    return (
        f"A's noise floor: the reference's own renders score {noise.reference_mean:.4f}{sd} "
        f"({plural(noise.n_reference, 'case', 'cases')})"
    )


def _noise(summary: ReconstructionSummary) -> list[str]:
    noise = summary.noise
    lines = []
    if floor := noise_floor(noise):
        lines.append(floor)
    elif summary.metrics["A"].value is not None:
        lines.append("A's noise floor was not measured when the dataset was made")
    else:
        lines.append("A and S are undefined: valid cases have no render (readout --no-render)")
    if noise.two_seeds is not None:
        lines.append(
            f"two seeds of a submission's render differ at {noise.two_seeds:.2%} of the pixels "
            f"({plural(noise.n_two_seeds, 'case', 'cases')})"
        )
    return lines


def _joints(summary: ReconstructionSummary) -> list[str]:
    """The articulation pilot, where a reference has joints."""
    articulation = summary.articulation
    if not articulation:
        return []
    counts = ", ".join(f"{letter} {getattr(articulation, letter)}" for letter in "CWPOJE")
    score = "-" if articulation.score is None else f"{articulation.score:.4f}"
    return [
        f"articulation (pilot {articulation.card_version}, in no score): {score} "
        f"({counts}; {plural(articulation.cases, 'case', 'cases')})"
    ]


def _rows(found: Means) -> list[MetricRow]:
    first = (*_SCORES, *_VALID)
    names = sorted(found, key=lambda n: (first.index(n) if n in first else len(first), n))
    return [
        MetricRow(
            name=name,
            number=number_cell(found[name].value, found[name].interval),
            over=f"{plural(found[name].n, 'case', 'cases')}, {found[name].over}",
        )
        for name in names
    ]


def _size(group: Group) -> str:
    families = plural(group.families, "family", "families")
    return f"{plural(group.cases, 'case', 'cases')}, {families}"
