"""Three or more systems over the same images: one against each other, and photo by photo."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from legoworld.comparison.ranks import RankedSides, rank_sides
from legoworld.records.comparison import ComparisonSettings
from legoworld.records.report_page import PhotoRow
from legoworld.report.family import load_page_family
from legoworld.report.sources import Section
from legoworld.tables.table import Cell, Column, Number, Table, Text, table

#: Two have their comparison.
_FEWEST: Final = 3
#: As `legoworld compare` draws by default.
_SETTINGS: Final = ComparisonSettings(draws=2000, seed=0, allow_truth_prompts=True)
_MOST_PHOTOS: Final = 200


def systems_table(section: Section) -> tuple[Table, ...]:
    """Ranks and paired differences of a section's sides; none for fewer than three.

    Nor for a family whose runs are repeated: they have a leaderboard of their own.
    """
    family = load_page_family(section.task)
    partial = any(side.summary.partial for side in section.sides)
    if len(section.sides) < _FEWEST or partial or family.by_folder:
        return ()
    metric, label = next(iter(family.forest.items()))
    ranked = rank_sides(section.sides, metric, _SETTINGS)
    return () if ranked is None else (_ranks_table(section, ranked, label),)


def photos_table(section: Section, rows: Sequence[PhotoRow]) -> tuple[Table, ...]:
    """What each side has on each photo: first those that a side failed, then the widest apart."""
    if len(section.sides) < _FEWEST or not rows:
        return ()
    ordered = sorted(rows, key=lambda row: (_apart(row), row.id))[:_MOST_PHOTOS]
    cells = [
        (
            Text(text=row.file_name, link=f"#/{section.key}/{row.id}"),
            *(cell.status if cell.status != "ok" else _number(cell.number) for cell in row.cells),
        )
        for row in ordered
    ]
    note = "Each photo's own number, as its card has it;"
    of = "" if len(ordered) == len(rows) else f" {len(ordered)} of {len(rows)}:"
    return (
        table(
            ["photo", *(side.name for side in section.sides)],
            cells,
            title="Every photo by system",
            notes=[f"{note}{of} those that a side failed first, then the widest apart."],
        ),
    )


def _ranks_table(section: Section, ranking: RankedSides, label: str) -> Table:
    names = [side.name for side in section.sides]
    minus = [f"minus {k + 1}" for k in range(len(names))]
    rows: list[tuple[Cell, ...]] = []
    for i, name in enumerate(names):
        rank = ranking.ranks[i]
        spread = "" if rank.low is None else f" [{rank.low}, {rank.high}]"
        value = Number(value=_nan_to_none(ranking.values[i]))
        rows.append((i + 1, name, value, f"{rank.rank}{spread}", *_differences(ranking, i)))
    better = "lower" if ranking.metric.better == "lower" else "higher"
    return Table(
        columns=tuple(Column(name=name) for name in ("", "system", label, "rank", *minus)),
        rows=tuple(rows),
        title="Systems",
        notes=(
            f"{label} over all attempted images, {better} is better; 95 % intervals of "
            f"differences and ranks over {_SETTINGS.draws} draws of {ranking.unit}s, the same for "
            "all systems. A difference whose interval contains 0 tells no two apart.",
        ),
    )


def _differences(ranking: RankedSides, i: int) -> list[Cell]:
    cells: list[Cell] = []
    for j in range(len(ranking.values)):
        if i == j:
            cells.append("")
            continue
        value, interval = ranking.differences[i, j]
        ends = interval.ends if interval else None
        cells.append(Number(value=_nan_to_none(value), ends=ends, signed=True))
    return cells


def _nan_to_none(value: float) -> float | None:
    return None if value != value else float(value)


def _number(value: float | None) -> Number:
    return Number(value=value, digits=3)


def _apart(row: PhotoRow) -> tuple[bool, float]:
    """Sorts by it: photos that a side failed first, then the widest apart."""
    known = [cell.number for cell in row.cells if cell.number is not None]
    spread = max(known) - min(known) if known else 0.0
    return all(cell.status == "ok" for cell in row.cells), -spread
