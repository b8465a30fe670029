"""A bench's leaderboard, tiers and flags."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from legoworld.comparison.leaderboard import leaderboard
from legoworld.comparison.provenance import NOT_RECORDED
from legoworld.evaluation.reconstruction import means
from legoworld.evaluation.reconstruction.text import noise_floor
from legoworld.pluralize import plural
from legoworld.records.bench_results import Leaderboard, LeaderboardRow, Repeated
from legoworld.records.report_tables import BenchTables, FirstScreen, SideCosts, TierBar, Verdict
from legoworld.report.first_screen import first_screen
from legoworld.report.reconstruction_pictures import OUTCOMES, error_steps
from legoworld.report.sources import ReportInputError, Section
from legoworld.tables.table import Cell, Number, Table, Text, table

#: From how many sides on the leaderboard stands for the plot.
MOST_PLOTTED: Final = 3
_BARS: Final = ("S", "R", "A")


def bench_tables(section: Section) -> BenchTables:
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
    floors = (noise_floor(side.reconstruction.noise) for side in sides)
    board = leaderboard(sides, draws=rules.bootstrap.draws, seed=rules.bootstrap.seed)
    return BenchTables(
        board=board,
        tiers=tuple(bar for row in board.rows for bar in _tier_bars(row)),
        outcomes=OUTCOMES,
        errors=error_steps(rules.protocol.delta),
        delta=rules.protocol.delta,
        tolerance=rules.protocol.tolerance,
        noise_floor=next(filter(None, floors), ""),
    )


def bench_first_screen(
    section: Section, board: Leaderboard, costs: Sequence[SideCosts]
) -> FirstScreen:
    """The first screen of several evaluations: who leads; the plot where it can be read."""
    first, sides = first_screen(section, costs), section.sides
    if section.comparison is None and len(sides) > 1:
        first = replace(first, verdicts=(Verdict(sentence=_leads(board), standing="alone"),))
    return replace(first, forest=first.forest if len(sides) <= MOST_PLOTTED else ())


def maker_name(row: LeaderboardRow) -> str:
    """Agent and model, or its evaluations where neither is on record."""
    known = [text for text in (row.agent, row.model) if text != NOT_RECORDED]
    return " ".join(known) or ", ".join(row.evaluations)


def _leads(board: Leaderboard) -> str:
    """The best row in a sentence; a tie of single runs is not told apart here."""
    first = board.rows[0]
    every = first.groups[0]
    found = every.metrics["S"] if every.metrics["S"].mean is not None else every.metrics["R"]
    name = "S" if found is every.metrics["S"] else "R"
    ends = found.interval.ends if found.interval else None
    spread = " [{:.3f}, {:.3f}]".format(*ends) if ends else ""
    runs = plural(len(first.evaluations), "run", "runs")
    cases = plural(every.cases, "case", "cases")
    value = "undefined" if found.mean is None else f"{found.mean:.3f}{spread}"
    if len(board.rows) == 1:
        return f"{maker_name(first)}: {name} {value} over {cases}, mean of {runs}."
    return (
        f"Highest {name} of {len(board.rows)}: {maker_name(first)}, {value} over {cases}, {runs}."
    )


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


def leaderboard_table(tables: BenchTables) -> Table:
    """A line for each agent and model, the best first, over all cases."""
    shown = ("S", "R", "A", "V", "S_valid", "R_valid", "A_valid")
    rows: list[list[Cell]] = []
    for row in tables.board.rows:
        every = row.groups[0]
        n_valid = ", ".join(map(str, every.metrics["S_valid"].n))
        rows.append(
            [
                Text(text=row.agent, below="" if row.model == NOT_RECORDED else row.model),
                *(_mean_of_runs(every.metrics[name]) for name in shown),
                f"{n_valid} of {every.cases}",
                ", ".join(row.evaluations),
            ]
        )
    header = ("agent and model", *(name.replace("_", " ") for name in shown), "valid", "runs")
    note = (
        "S = V (R + A) / 2. S, R, A and V are over all attempted cases, where one that is not "
        'valid counts 0; "valid" are means over the valid cases alone. In brackets [ ]: the 95 % '
        "interval over two families or more; sd: the standard deviation over runs."
    )
    return table(header, rows, notes=[*filter(None, (note, tables.noise_floor))])


def second_card_tables(tables: BenchTables) -> list[Table]:
    """Both cards side by side, where the evaluations are of bench-x."""
    if means.SECOND[0] not in tables.board.rows[0].groups[0].metrics:
        return []
    shown = ("R", "A", "S", *means.SECOND)
    rows: list[list[Cell]] = [
        [
            Text(text=row.agent, below="" if row.model == NOT_RECORDED else row.model),
            *(_mean_of_runs(row.groups[0].metrics[name]) for name in shown),
        ]
        for row in tables.board.rows
    ]
    note = (
        "Over all attempted cases. R, A and S are LEGO-Bench's; the others are of bench-x, and in "
        "no score: R_p of moved samples, R_x and A_x of a second view, F3D and found of whole "
        "objects, R_empty of the reference without its objects, "
        "R_above_empty = (R - R_empty) / (1 - R_empty)."
    )
    header = ("agent and model", *(name.replace("_", " ") for name in shown))
    return [table(header, rows, title="Both cards", notes=[note])]


def _mean_of_runs(found: Repeated) -> Number:
    """A mean over runs with its interval, and its standard deviation below that."""
    mean = Number(value=found.mean, sd=found.sd, digits=3)
    ends = found.interval.ends if found.interval else None
    return replace(mean, ends=ends, below=mean.interval_text) if ends else mean


def flag_tables(section: Section) -> list[Table]:
    """Every integrity flag with its measurement, where there are any."""
    rows: list[tuple[Cell, ...]] = [
        (
            Text(text=flag.file_name, link=f"#/{section.key}/{flag.image_id}"),
            side.name,
            flag.kind.replace("_", " "),
            flag.what,
            Number(value=flag.measured, digits=3),
            f"{flag.threshold:g}",
        )
        for side in section.sides
        for flag in side.reconstruction.flags
    ]
    note = "Flags change no score: they name what a person should look at."
    header = ("case", "of", "flag", "what", "measured", "from")
    title = plural(len(rows), "integrity flag", "integrity flags")
    return [table(header, rows, title=title, notes=[note], folded=True)] if rows else []
