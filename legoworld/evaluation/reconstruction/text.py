"""An evaluation of a bench as text: both averages, the noise, flags, and what counts 0."""

from __future__ import annotations

from typing import Final

from legoworld.evaluation.family import TextTable
from legoworld.evaluation.short_text import SHORT, bounds, evaluator_of, fraction
from legoworld.pluralize import counted
from legoworld.records.reconstruction_summary import Group, Mean, Means, ReconstructionSummary

_SCORES: Final = ("V", "R", "A", "S")
_VALID: Final = ("R_valid", "A_valid", "S_valid")


def short_bench(summary: ReconstructionSummary) -> str:
    """V, R, A, S with both averages and their denominators, A's noise, flags, what counts 0."""
    lines = [_title(summary), *_averages(summary.metrics), *_noise(summary), *_joints(summary)]
    if summary.flags:
        cases = counted(len({flag.image_id for flag in summary.flags}), "case", "cases")
        lines.append(
            f"{counted(len(summary.flags), 'flag', 'flags')} in {cases}; no score was changed "
            "(-v lists all)"
        )
    rows = summary.not_scored
    lines += [f"0: {r.status}: {r.file_name}: {r.reason}" for r in rows[:SHORT]]
    if len(rows) > SHORT:
        more = counted(len(rows) - SHORT, "more case", "more cases")
        lines.append(f"... and {more} that count 0 (-v lists all)")
    return "\n".join(lines)


def bench_text(summary: ReconstructionSummary, table: TextTable) -> str:
    """Every mean with its interval and denominator, groups, diagnostics, flags and zeros."""
    header = ("metric", "mean", "95 % interval", "over")
    main = [_row(name, mean) for name, mean in summary.metrics.items()]
    groups = [
        (
            f"{kind} {name}",
            *(fraction(group.metrics[m].value) for m in (*_SCORES, *_VALID)),
            _size(group),
        )
        for kind in ("tier", "split", "environment", "theme")
        for name, group in getattr(summary.groups, kind).items()
    ]
    beside = [_row(name, mean) for name, mean in summary.diagnostics.items()]
    parts = [
        _title(summary),
        table(header, main),
        table(("group", *_SCORES, *_VALID, "over"), groups),
    ]
    if beside:
        parts.append("diagnostics, in no score:\n" + table(header, beside))
    ends = _noise(summary) + _joints(summary)
    ends += [
        f"flag: {f.kind}: {f.file_name}: {f.what}: {f.measured:.3f} (from {f.threshold:g})"
        for f in summary.flags
    ]
    ends += [f"0: {r.status}: {r.file_name}: {r.reason}" for r in summary.not_scored]
    return "\n\n".join([*parts, "\n".join(ends)] if ends else parts)


def _title(summary: ReconstructionSummary) -> str:
    coverage, rules = summary.coverage, summary.protocol
    sampling = "" if rules.reference_sampling == "raster" else f", {rules.reference_sampling}"
    partial = "; partial run" if summary.partial else ""
    return (
        f"{evaluator_of(summary)}, bench{sampling}: "
        f"{counted(coverage.attempted, 'case', 'cases')} attempted, {coverage.scored} compared, "
        f"{coverage.valid} valid; intervals over "
        f"{counted(summary.bootstrap.groups, 'family', 'families')}{partial}"
    )


def _averages(metrics: Means) -> list[str]:
    all_cases = (f"{m} {fraction(metrics[m].value)}{bounds(metrics[m].interval)}" for m in _SCORES)
    valid = (f"{m[0]} {fraction(metrics[m].value)}" for m in _VALID)
    return [
        f"over all {metrics['S'].n} attempted, zeros included: {', '.join(all_cases)}",
        f"over the {metrics['S_valid'].n} valid: {', '.join(valid)}",
    ]


def _noise(summary: ReconstructionSummary) -> list[str]:
    noise = summary.noise
    lines = []
    if noise.reference_mean is not None and noise.reference_sd is not None:
        cases = counted(noise.n_reference, "case", "cases")
        lines.append(
            f"A's noise floor: the reference's own renders score {noise.reference_mean:.4f}, "
            f"sd {noise.reference_sd:.4f} between seeds ({cases})"
        )
    elif summary.metrics["A"].value is not None:
        lines.append("A's noise floor was not measured when the dataset was made")
    else:
        lines.append("A and S are undefined: valid cases have no render (readout --no-render)")
    if noise.two_seeds is not None:
        lines.append(
            f"two seeds of a submission's render differ at {noise.two_seeds:.2%} of the pixels "
            f"({counted(noise.n_two_seeds, 'case', 'cases')})"
        )
    return lines


def _joints(summary: ReconstructionSummary) -> list[str]:
    """The articulation pilot, where a reference has joints."""
    found = summary.articulation
    if not found:
        return []
    counts = ", ".join(f"{letter} {getattr(found, letter)}" for letter in "CWPOJE")
    score = "-" if found.score is None else f"{found.score:.4f}"
    return [
        f"articulation (pilot {found.card_version}, in no score): {score} "
        f"({counts}; {counted(found.cases, 'case', 'cases')})"
    ]


def _row(name: str, mean: Mean) -> tuple[str, str, str, str]:
    return name, fraction(mean.value), bounds(mean.interval).strip() or "-", f"{mean.n} {mean.over}"


def _size(group: Group) -> str:
    families = counted(group.families, "family", "families")
    return f"{counted(group.cases, 'case', 'cases')}, {families}"
