"""A bench's leaderboard, tiers, flags, and what costs R most."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from msgspec.structs import replace

from legoworld.comparison.leaderboard import leaderboard
from legoworld.evaluation.stored import Evaluated
from legoworld.pluralize import counted, range_text, share
from legoworld.records.base import UNSET
from legoworld.records.reconstruction_leaderboard import Leaderboard, LeaderboardRow
from legoworld.records.reconstruction_summary import Mean, NoiseSummary
from legoworld.records.report_reconstruction import (
    BenchTables,
    FlaggedCase,
    Loss,
    SideLosses,
    TierBar,
)
from legoworld.records.report_summary import FirstScreen, Verdict
from legoworld.records.report_tables import NumberCell, NumberRow
from legoworld.report.reconstruction_pictures import OUTCOMES, error_steps
from legoworld.report.sources import ReportInputError, Section

#: How many categories are named, and from how many sides on the leaderboard stands for the plot.
_MOST: Final = 6
MOST_PLOTTED: Final = 3
_FIRST: Final = ("V", "R", "A", "S", "R_valid", "A_valid", "S_valid")
_BARS: Final = ("S", "R", "A")


def bench_tables(section: Section, ids: Mapping[str, int]) -> BenchTables:
    """What only a bench's section has. ReportInputError for sides of other rules."""
    sides, rules = section.sides, section.sides[0].reconstruction
    for side in sides[1:]:
        mine = (side.reconstruction.evaluator, side.reconstruction.protocol)
        if mine != (rules.evaluator, rules.protocol):
            raise ReportInputError(
                f"{side.folder.name} was scored by other rules than {sides[0].folder.name}",
                found=f"{mine[0].version}, {mine[1].reference_sampling}",
                expected=f"{rules.evaluator.version}, {rules.protocol.reference_sampling}",
                next_step="make a page of each",
            )
    floors = (_noise_floor(side.reconstruction.noise) for side in sides)
    board = leaderboard(sides, draws=rules.bootstrap.draws, seed=rules.bootstrap.seed)
    return BenchTables(
        board=board,
        losses=tuple(_losses(side, ids) for side in sides),
        flags=tuple(flag for side in sides for flag in _flags(side)),
        tiers=tuple(bar for row in board.rows for bar in _tier_bars(row)),
        outcomes=OUTCOMES,
        errors=error_steps(rules.protocol.delta),
        delta=rules.protocol.delta,
        tolerance=rules.protocol.tolerance,
        noise_floor=next(filter(None, floors), ""),
    )


def first_of_bench(first: FirstScreen, section: Section, board: Leaderboard) -> FirstScreen:
    """The first screen of several evaluations: who leads; the plot where it can be read."""
    sides = section.sides
    if section.comparison is None and len(sides) > 1:
        first = replace(first, verdicts=(Verdict(sentence=_leads(board), standing="alone"),))
    return replace(first, forest=first.forest if len(sides) <= MOST_PLOTTED else ())


def maker_name(row: LeaderboardRow) -> str:
    """Agent and model, or its evaluations where neither is on record."""
    known = [text for text in (row.agent, row.model) if text != "not recorded"]
    return " ".join(known) or ", ".join(row.evaluations)


def _leads(board: Leaderboard) -> str:
    """The best row in a sentence; a tie of single runs is not told apart here."""
    first = board.rows[0]
    every = first.groups[0]
    found = every.metrics["S"] if every.metrics["S"].mean is not None else every.metrics["R"]
    name = "S" if found is every.metrics["S"] else "R"
    ends = found.interval.ends if found.interval else None
    spread = " [{:.3f}, {:.3f}]".format(*ends) if ends else ""
    runs = counted(len(first.evaluations), "run", "runs")
    cases = counted(every.cases, "case", "cases")
    value = "undefined" if found.mean is None else f"{found.mean:.3f}{spread}"
    if len(board.rows) == 1:
        return f"{maker_name(first)}: {name} {value} over {cases}, mean of {runs}."
    return (
        f"Highest {name} of {len(board.rows)}: {maker_name(first)}, {value} over {cases}, {runs}."
    )


def _losses(side: Evaluated, ids: Mapping[str, int]) -> SideLosses:
    """What is missing to R = 1, by category; cases that are not valid lose all of it."""
    rows = side.reconstruction_rows
    lost: dict[str, float] = dict.fromkeys(ids, 0.0)
    scores: dict[str, list[float]] = {name: [] for name in ids}
    not_valid = 0.0
    for row in rows:
        eligible = [o for o in row.objects if o.eligible]
        if not row.valid or not eligible:
            not_valid += (1.0 - (row.R or 0.0)) / len(rows)
            continue
        for scored in eligible:
            lost[scored.category] += (1.0 - scored.f1) / len(eligible) / len(rows)
            scores[scored.category].append(scored.f1)
    order = sorted((n for n in ids if scores[n] and lost[n] > 0), key=lambda n: (-lost[n], n))
    return SideLosses(
        label=side.name,
        lost=sum(lost.values()) + not_valid,
        not_valid=not_valid,
        most=tuple(
            Loss(
                category=ids[name],
                name=name,
                objects=len(scores[name]),
                mean_f1=sum(scores[name]) / len(scores[name]),
                lost=lost[name],
            )
            for name in order[:_MOST]
        ),
    )


def _flags(side: Evaluated) -> list[FlaggedCase]:
    return [
        FlaggedCase(
            label=side.name,
            image_id=flag.image_id,
            file_name=flag.file_name,
            kind=flag.kind,
            what=flag.what,
            measured=flag.measured,
            threshold=flag.threshold,
        )
        for flag in side.reconstruction.flags
    ]


def _tier_bars(row: LeaderboardRow) -> Iterator[TierBar]:
    tiers = [group for group in row.groups if group.kind == "tier"]
    for metric in _BARS if tiers else ():
        found = [group.metrics[metric] for group in tiers]
        if any(one.mean is not None for one in found):
            yield TierBar(
                label=row.evaluations[0] if len(row.evaluations) == 1 else maker_name(row),
                metric=metric,
                tiers=tuple(group.name for group in tiers),
                cases=tuple(group.cases for group in tiers),
                values=tuple(one.mean for one in found),
                sds=tuple(one.sd for one in found),
            )


def bench_rows(sides: Sequence[Evaluated]) -> list[NumberRow]:
    """Every metric and diagnostic mean with its interval and denominator."""
    rows = []
    for kind in ("metrics", "diagnostics"):
        named = {name for side in sides for name in getattr(side.reconstruction, kind)}
        names = sorted(named, key=lambda n: (_FIRST.index(n) if n in _FIRST else len(_FIRST), n))
        for name in names:
            cells = [getattr(side.reconstruction, kind).get(name) for side in sides]
            rows.append(NumberRow(name=_spelt(name), cells=tuple(map(_cell, cells))))
    return rows


def _spelt(name: str) -> str:
    return name.replace("_", " ")


def _cell(mean: Mean | None) -> NumberCell | None:
    if mean is None:
        return None
    return NumberCell(
        value="-" if mean.value is None else f"{mean.value:.4f}",
        spread=range_text(mean.interval.ends if mean.interval else None),
        over=f"{counted(mean.n, 'case', 'cases')}, {mean.over}",
    )


def _noise_floor(noise: NoiseSummary) -> str:
    """A of the references rendered by the card; empty where it was not measured."""
    if noise.reference_mean is None:
        return ""
    sd = f", sd {noise.reference_sd:.4f} between seeds" if noise.reference_sd else ""
    return (
        f"A's noise floor: the reference's own renders score {noise.reference_mean:.4f}{sd} "
        f"({counted(noise.n_reference, 'case', 'cases')})"
    )


def bench_notes(side: Evaluated) -> list[str]:
    """Sentences about coverage, noise, and what counts 0."""
    summary = side.reconstruction
    coverage, noise = summary.coverage, summary.noise
    lines = [
        f"{share(coverage.valid, coverage.attempted, 'case', 'cases')} valid; the others count 0 "
        "in V, R, A and S",
        f"intervals: {counted(summary.bootstrap.draws, 'bootstrap draw', 'bootstrap draws')} over "
        f"{counted(summary.bootstrap.groups, 'family', 'families')}",
    ]
    lines += filter(None, [_noise_floor(noise)])
    if summary.articulation is not UNSET:
        found = summary.articulation
        score = "-" if found.score is None else f"{found.score:.4f}"
        cases = counted(found.cases, "case", "cases")
        lines.append(f"articulation, a pilot in no score: {score} ({cases})")
    lines += [f"{r.status}: {r.file_name}: {r.reason}" for r in summary.not_scored]
    return lines + (["partial run: only some images of its track"] if summary.partial else [])
