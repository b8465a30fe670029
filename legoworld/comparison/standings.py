"""N systems of a bench table against each other: ranks, paired differences, and what they cost."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Final, Literal

import numpy as np
from msgspec.structs import replace

from legoworld.comparison.provenance import recorded_provenance
from legoworld.comparison.ranks import paired_differences, rank_systems
from legoworld.evaluation.bootstrap import draw_groups, interval
from legoworld.evaluation.reconstruction import means
from legoworld.evaluation.reconstruction.points import F64
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.agents import ModelPrice, Usage
from legoworld.records.base import UNSET, RecordError, to_record
from legoworld.records.bench_results import (
    Cost,
    Leaderboard,
    LeaderboardRow,
    PairedDifference,
    Standings,
)
from legoworld.tables.table import Cell, Table, table

#: The standardised token cost: every model's tokens at this one price.
STANDARD: Final = ModelPrice(
    names=("standard",),
    source="docs/protocols/bench.md",
    input_usd=1.0,
    cached_input_usd=0.1,
    output_usd=8.0,
)


def with_standings(board: Leaderboard, sides: Sequence[StoredEvaluation]) -> Leaderboard:
    """Add ranks, paired differences, and costs recorded in the scenes' provenance.json.

    Ranks are by S over all attempted cases, or by R if a row has no S. Each draw takes the same
    families for all systems and runs. A single family has no interval.
    """
    rendered = all(row.groups[0].metrics["S"].mean is not None for row in board.rows)
    metric: Literal["S", "R"] = "S" if rendered else "R"
    (measure,) = [one for one in means.headline(()) if one.name == metric]
    families = [row.family for row in sides[0].reconstruction_rows]
    drawn = draw_groups(families, board.draws, board.seed)
    by_name = {side.name: side.reconstruction_rows for side in sides}
    used = {side.name: _usages(side) for side in sides}

    def samples(row: LeaderboardRow) -> F64:
        runs = []
        for name in row.evaluations:
            values = np.array([measure.value(case) for case in by_name[name]], np.float64)
            runs.append(drawn.means(values, [case.family for case in by_name[name]]))
        mean: F64 = np.mean(runs, axis=0)
        return mean

    values = np.array([row.groups[0].metrics[metric].mean for row in board.rows], np.float64)
    resampled = np.array([samples(row) for row in board.rows]) if drawn.spread else None
    pairs = paired_differences(
        combinations(range(len(values)), 2),
        values,
        resampled,
        lambda drawn, _: interval(drawn, unit="family"),
    )
    costs = [_cost([u for name in row.evaluations for u in used[name]]) for row in board.rows]
    standings = Standings(
        metric=metric,
        ranks=tuple(rank_systems(values, resampled)),
        pairs=tuple(
            PairedDifference(first=i, second=j, difference=difference, interval=between)
            for (i, j), (difference, between) in pairs.items()
        ),
        costs=tuple(_on_frontier(costs, values)),
    )
    return replace(board, standings=standings)


def standings_table(board: Leaderboard) -> Table:
    """A line for each system: its rank, its cost, and its difference to each other one."""
    standings = board.standings
    assert standings is not UNSET
    costs = standings.costs if any(cost.standard_told for cost in standings.costs) else ()
    pairs = {(pair.first, pair.second): pair for pair in standings.pairs}
    size = range(len(board.rows))
    header = ["", "agent", "model", "rank", *(["USD a trial", "at one price"] if costs else []),
              *(f"minus {k + 1}" for k in size)]  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for i, row in enumerate(board.rows):
        rank = standings.ranks[i]
        ends = "" if rank.low is None else f" [{rank.low}, {rank.high}]"
        shown = _money(costs[i]) if costs else ()
        others = [_difference(pairs, i, j) for j in size]
        rows.append((i + 1, row.agent, row.model, f"{rank.rank}{ends}", *shown, *others))
    notes = [
        f"minus k: {standings.metric} minus that of system k, in percent, with its 95 % interval; "
        "ranks with theirs: families drawn alike for all systems and runs.",
    ]
    if costs:
        notes.append(
            "USD a trial: as its transcript or price card says; at one price: all tokens at "
            f"{STANDARD.input_usd:g}, {STANDARD.cached_input_usd:g} (cached) and "
            f"{STANDARD.output_usd:g} (output) USD a million. *: on the frontier, no system is "
            "better and as cheap. n/m: n of m trials tell it, and it is on no frontier."
        )
    return table(header, rows, notes=notes)


def _usages(side: StoredEvaluation) -> list[Usage]:
    """What each attempted case's trial used, by its scene's provenance; nothing where untold."""
    used = []
    for made in recorded_provenance(side):
        told = made.provenance.get("usage") if isinstance(made.provenance, dict) else None
        try:
            usage = to_record(Usage, told or {})
        except RecordError:  # another's provenance.json
            usage = Usage()
        used += [usage if _possible(usage) else Usage()] * made.images
    return used + [Usage()] * (side.summary.coverage.attempted - len(used))


def _possible(usage: Usage) -> bool:
    """False for negative numbers and more cached tokens than prompt tokens."""
    prompt, cached = usage.prompt_tokens, usage.cached_tokens
    told = (prompt, cached, usage.completion_tokens, usage.cost_usd)
    if prompt is not None and cached is not None and cached > prompt:
        return False
    return not any(number is not None and number < 0 for number in told)


def _cost(usages: Sequence[Usage]) -> Cost:
    """Means over the trials that tell it."""
    usd = [usage.cost_usd for usage in usages]
    standard = [
        None if prompt is None or completion is None
        else STANDARD.cost_usd(prompt, cached or 0, completion)
        for prompt, cached, completion in (
            (u.prompt_tokens, u.cached_tokens, u.completion_tokens) for u in usages
        )
    ]  # fmt: skip
    return Cost(
        trials=len(usages),
        usd=_mean(usd),
        told=sum(one is not None for one in usd),
        standard_usd=_mean(standard),
        standard_told=sum(one is not None for one in standard),
        frontier=False,
        standard_frontier=False,
    )


def _mean(values: Sequence[float | None]) -> float | None:
    told = [value for value in values if value is not None]
    return sum(told) / len(told) if told else None


def _on_frontier(costs: Sequence[Cost], values: F64) -> Iterable[Cost]:
    """The costs, with the systems marked that none dominates."""

    def best(usd: Sequence[float | None], i: int) -> bool:
        """Whether no other system is at least as good and as cheap, and better in one."""
        own = usd[i]
        return own is not None and not any(
            other is not None
            and values[j] >= values[i]
            and other <= own
            and (values[j] > values[i] or other < own)
            for j, other in enumerate(usd)
        )

    usd = [c.usd if c.told == c.trials else None for c in costs]
    standard = [c.standard_usd if c.standard_told == c.trials else None for c in costs]
    for i, cost in enumerate(costs):
        yield replace(cost, frontier=best(usd, i), standard_frontier=best(standard, i))


def _money(cost: Cost) -> tuple[str, str]:
    def format_cost(usd: float | None, told: int, frontier: bool) -> str:
        if usd is None:
            return "-"
        some = "" if told == cost.trials else f" {told}/{cost.trials}"
        return f"{usd:.4f}{' *' if frontier else some}"

    return (
        format_cost(cost.usd, cost.told, cost.frontier),
        format_cost(cost.standard_usd, cost.standard_told, cost.standard_frontier),
    )


def _difference(pairs: Mapping[tuple[int, int], PairedDifference], i: int, j: int) -> str:
    pair = pairs.get((min(i, j), max(i, j)))
    if pair is None:
        return ""
    sign = 1 if i < j else -1
    text = f"{100 * sign * pair.difference + 0.0:+.1f}"
    if pair.interval is None or pair.interval.ends is None:
        return text
    low, high = sorted(100 * sign * end + 0.0 for end in pair.interval.ends)
    return f"{text} [{low:.1f}, {high:.1f}]"
