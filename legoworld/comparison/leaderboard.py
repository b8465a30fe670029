"""`legoworld bench table`: evaluations of bench runs to one row for each agent and model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from msgspec import structs

from legoworld.comparison.compatibility import check_comparable, distinct_names
from legoworld.comparison.provenance import NOT_RECORDED, recorded_provenance
from legoworld.comparison.standings import standings_table
from legoworld.errors import ConfigurationMismatchError, UsageError
from legoworld.evaluation.bootstrap import draw_groups, interval
from legoworld.evaluation.reconstruction import means
from legoworld.evaluation.stored import StoredEvaluation, read_evaluation
from legoworld.files import sha256_of_file, write_text
from legoworld.pluralize import plural
from legoworld.records.base import UNSET, readable
from legoworld.records.bench_results import Leaderboard, LeaderboardGroup, LeaderboardRow, Repeated
from legoworld.records.folders.read_evaluation import EVIDENCE
from legoworld.records.reconstruction import Means
from legoworld.tables.files import FORMATS
from legoworld.tables.table import Cell, Number, Table, table
from legoworld.tasks.registry import find_family
from legoworld.tasks.shipped import RECONSTRUCTION

DOCUMENT: Final = "leaderboard.json"
FILES: Final = (
    DOCUMENT,
    *(f"{name}.{suffix}" for name in ("leaderboard", "standings") for suffix in FORMATS),
)
_KINDS: Final = ("split", "environment", "theme", "tier")
_SHOWN: Final = ("V", "R", "A", "S", "R_valid", "A_valid", "S_valid")


def read_entries(evaluations: Sequence[Path]) -> list[StoredEvaluation]:
    """Bench evaluations of one dataset, card and sampling. UsageError, IncomparableError."""
    sides = [read_evaluation(folder) for folder in evaluations]
    for side in sides:
        if find_family(side.task) is not RECONSTRUCTION:
            raise UsageError(
                f"{side.folder.name} is no evaluation of a bench",
                found=f"task {side.task!r}",
                expected="folders that `legoworld evaluate` made of bench runs",
            )
    folders = [side.folder.resolve() for side in sides]
    names = distinct_names([(folder.name, folder.parent.name) for folder in folders])
    named = [replace(side, name=name) for side, name in zip(sides, names, strict=True)]
    check_comparable(named, allow_truth_prompts=False)
    return named


def case_scores(side: StoredEvaluation) -> dict[str, tuple[float | None, float | None]]:
    """R and A of each case of a bench evaluation, by its file name; zeros where it is not valid."""
    return {row.file_name: (row.R, row.A) for row in side.reconstruction_rows}


def leaderboard(
    sides: Sequence[StoredEvaluation], *, draws: int = 10_000, seed: int = 0
) -> Leaderboard:
    """One row for each agent and model, over all its evaluated runs."""
    by_maker: dict[tuple[str, str], list[StoredEvaluation]] = {}
    for side in sides:
        by_maker.setdefault(_maker(side), []).append(side)
    rows = [_row(maker, runs, draws, seed) for maker, runs in by_maker.items()]
    return Leaderboard(
        task=sides[0].task,
        evaluator=sides[0].summary.evaluator,
        draws=draws,
        seed=seed,
        rows=tuple(sorted(rows, key=lambda row: (-_score(row), row.agent, row.model))),
        evidence_sha256={side.name: sha256_of_file(side.folder / EVIDENCE) for side in sides},
    )


def write_leaderboard(folder: Path, board: Leaderboard, *, overwrite: bool) -> None:
    """leaderboard.json, .md, .tex, .csv, and standings.*; a folder with others is refused.

    Raises ConfigurationMismatchError for such a folder, and for another table without overwrite.
    """
    folder.mkdir(parents=True, exist_ok=True)
    strangers = sorted(path.name for path in folder.iterdir() if path.name not in FILES)
    there = folder / DOCUMENT
    text = readable(board)
    if strangers or (there.is_file() and not overwrite and there.read_text("utf-8") != text):
        raise ConfigurationMismatchError(
            "the output folder holds something else",
            found=", ".join(strangers[:5]) or "the table of other evaluations",
            expected="an empty folder or the same table",
            next_step="choose another -o" + ("" if strangers else ", or pass --overwrite"),
        )
    write_text(there, text)
    for suffix, render in FORMATS.items():
        shown = long_table(board) if suffix == "csv" else wide_table(board)
        write_text(folder / f"leaderboard.{suffix}", render(shown))
        if board.standings is not UNSET:
            write_text(folder / f"standings.{suffix}", render(standings_table(board)))


def wide_table(board: Leaderboard, *, every_group: bool = True) -> Table:
    """A line for each agent, model and group, in percent: mean (sd) over runs."""
    shown = shown_metrics(board)
    rows: list[tuple[Cell, ...]] = [
        (row.agent, row.model, len(row.evaluations), _group_name(group), group.cases,
         *(_percent(group.metrics[name]) for name in shown))
        for row in board.rows
        for group in (row.groups if every_group else row.groups[:1])
    ]  # fmt: skip
    header = ("agent", "model", "runs", "group", "cases", *(n.replace("_", " ") for n in shown))
    return table(header, rows, notes=_notes(board))


def shown_metrics(board: Leaderboard) -> tuple[str, ...]:
    """The metrics of a wide table: both cards' where the evaluations are of bench-x."""
    known = board.rows[0].groups[0].metrics
    return (*_SHOWN, *(name for name in means.SECOND if name in known))


def long_table(board: Leaderboard) -> Table:
    """A line for each number, unrounded, for programs."""
    rows: list[tuple[Cell, ...]] = [
        (row.agent, row.model, len(row.evaluations), group.kind, group.name, name, found.over,
         Number(value=found.mean), Number(value=found.sd), *_ends(found),
         " ".join(map(str, found.n)))
        for row in board.rows
        for group in row.groups
        for name, found in group.metrics.items()
    ]  # fmt: skip
    header = ("agent", "model", "runs", "group_kind", "group", "metric", "over", "mean", "sd",
              "low", "high", "denominators")  # fmt: skip
    return table(header, rows)


def _notes(board: Leaderboard) -> list[str]:
    notes = [
        "In percent: mean (standard deviation with ddof = 1) over runs.",
        "V, R, A, S: over all attempted cases, a submission that is not valid counts 0. R, A, S "
        "valid: over the valid cases of each run.",
    ]
    single = [f"{row.agent} {row.model}" for row in board.rows if len(row.evaluations) < 2]
    if single:
        named = "every row" if len(single) == len(board.rows) > 1 else "; ".join(single)
        notes.append(f"{named}: a single run, so no standard deviation.")
    for row in board.rows:
        every = row.groups[0].metrics["S"]
        if every.interval and every.interval.ends:
            low, high = (100 * end for end in every.interval.ends)
            draws = plural(board.draws, "draw", "draws")
            notes.append(
                f"{row.agent} {row.model}: S [{low:.1f}, {high:.1f}] (95 %, {draws} of families)."
            )
        elif every.mean is None:
            notes.append(f"{row.agent} {row.model}: A and S are undefined: no render of a case.")
        else:
            notes.append(f"{row.agent} {row.model}: a single family, so no interval.")
    return notes


def _maker(side: StoredEvaluation) -> tuple[str, str]:
    """Agent and model that the run's scenes name; several are all named."""
    provenances = [one.provenance for one in recorded_provenance(side)]

    def provenance_value(field: str) -> str:
        values = {
            str(p[field]) for p in provenances if isinstance(p, dict) and p.get(field) is not None
        }
        return " + ".join(sorted(values)) or NOT_RECORDED

    return provenance_value("agent"), provenance_value("model")


def _row(
    maker: tuple[str, str], runs: Sequence[StoredEvaluation], draws: int, seed: int
) -> LeaderboardRow:
    groups = [_group("all", "all", [run.reconstruction.metrics for run in runs], len(runs[0].rows))]
    groups[0] = _with_intervals(groups[0], runs, draws, seed)
    for kind in _KINDS:
        by_name = [getattr(run.reconstruction.groups, kind) for run in runs]
        for name, group in sorted(by_name[0].items(), key=lambda one: means.group_order(one[0])):
            if name != means.UNSTATED or len(by_name[0]) > 1:
                groups.append(_group(kind, name, [one[name].metrics for one in by_name],
                                     group.cases))  # fmt: skip
    return LeaderboardRow(
        agent=maker[0],
        model=maker[1],
        evaluations=tuple(run.name for run in runs),
        groups=tuple(groups),
    )


def _group(kind: str, name: str, runs: Sequence[Means], cases: int) -> LeaderboardGroup:
    metrics = {}
    for metric, first in runs[0].items():
        values = [run[metric].value for run in runs]
        defined = [value for value in values if value is not None]
        mean, sd = means.mean_and_sd(defined) if len(defined) == len(runs) else (None, None)
        metrics[metric] = Repeated(
            mean=mean,
            sd=sd,
            runs=tuple(values),
            n=tuple(run[metric].n for run in runs),
            over=first.over,
            interval=None,
        )
    return LeaderboardGroup(kind=kind, name=name, cases=cases, metrics=metrics)


def _with_intervals(
    group: LeaderboardGroup, runs: Sequence[StoredEvaluation], draws: int, seed: int
) -> LeaderboardGroup:
    """Intervals of the mean over runs: each family is drawn in all runs together."""
    shared = draw_groups([row.family for row in runs[0].reconstruction_rows], draws, seed)
    if not shared.spread:
        return group
    known = [name for name, found in group.metrics.items() if found.over == "attempted"]
    metrics = dict(group.metrics)
    others = [n for n in known if n not in (*_SHOWN, *means.SECOND)]
    second = means.SECOND[0] in known
    for measure in means.headline(others, second=second):
        if measure.name not in known or metrics[measure.name].mean is None:
            continue
        samples = []
        for run in runs:
            rows = run.reconstruction_rows
            values = np.array([measure.value(row) for row in rows], np.float64)
            samples.append(shared.means(values, [row.family for row in rows]))
        bounds = interval(np.mean(samples, axis=0), unit="family")
        metrics[measure.name] = structs.replace(metrics[measure.name], interval=bounds)
    return structs.replace(group, metrics=metrics)


def _score(row: LeaderboardRow) -> float:
    """S over all attempted; R where there is no A."""
    metrics = row.groups[0].metrics
    value = metrics["S"].mean if metrics["S"].mean is not None else metrics["R"].mean
    return -1.0 if value is None else value


def _group_name(group: LeaderboardGroup) -> str:
    return group.name if group.kind == "all" else f"{group.kind} {group.name}"


def _percent(repeated: Repeated) -> Cell:
    mean = Number(value=None if repeated.mean is None else 100 * repeated.mean, digits=1)
    return mean if repeated.sd is None else f"{mean} ({100 * repeated.sd:.1f})"


def _ends(repeated: Repeated) -> tuple[Number, Number]:
    low, high = (repeated.interval.ends if repeated.interval else None) or (None, None)
    return Number(value=low), Number(value=high)
