"""The cases of a bench run, each scored by whatever worker is free; an error is tried twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.errors import one_line
from legoworld.evaluation.checks import refuse_unseen
from legoworld.evaluation.reconstruction.case import CaseTask, score_case, zero_row
from legoworld.evaluation.reconstruction.dataset import BenchTruthError, BenchUnseenError
from legoworld.evaluation.reconstruction.submission import row_files
from legoworld.records.reconstruction import EVALUATOR_ERROR, ReconstructionRow
from legoworld.workers.tasks import WorkerPool, map_items

#: Fewer cases than this are scored by the time that other processes have started.
_FEW: Final = 16


@dataclass(frozen=True, kw_only=True)
class SeenTask:
    """A case, and the sizes of its files as the command sees them, by absolute path."""

    task: CaseTask
    sizes_bytes: dict[Path, int]


@dataclass(frozen=True, kw_only=True)
class CaseResult:
    """A row, or what was raised instead of it, in words."""

    row: ReconstructionRow | None
    error: str | None


def seen_tasks(tasks: Sequence[CaseTask]) -> list[SeenTask]:
    """Tasks with the sizes of the files that each of them reads."""
    listed = []
    for task in tasks:
        row, case, folders = task.row, task.case, task.folders
        named = [task.run / f.file for f in row_files(row)]
        paths = [*named, folders.arrays("raster", case), folders.reference(case)]
        sizes = {path: path.stat().st_size for path in paths if path.is_file()}
        listed.append(SeenTask(task=task, sizes_bytes=sizes))
    return listed


def scored_cases(tasks: Sequence[SeenTask], pool: WorkerPool) -> Iterator[ReconstructionRow]:
    """Every case's row, in the tasks' order. A case that fails twice is a row of zeros."""
    used = pool.for_work(worth_a_process=len(tasks) >= _FEW)
    for seen, scored in zip(tasks, map_items(score_seen, tasks, used), strict=True):
        if scored.row is None:
            scored = _again(seen)
        if scored.row is not None:
            yield scored.row
        else:
            yield replace(
                zero_row(seen.task),
                status=EVALUATOR_ERROR,
                code=EVALUATOR_ERROR,
                reason=scored.error,
            )


def _again(seen: SeenTask) -> CaseResult:
    """Once more, in a fresh process."""
    fresh = WorkerPool(engine="local", workers=2)
    return next(iter(map_items(score_seen, [seen], fresh)))


def score_seen(seen: SeenTask) -> CaseResult:
    """Score one case. BenchUnseenError where the command's files are not to be seen here."""
    refuse_unseen(seen.sizes_bytes, f"the files of {seen.task.row.file_name}", BenchUnseenError)
    try:
        return CaseResult(row=score_case(seen.task), error=None)
    except BenchTruthError:
        raise
    except Exception as error:  # noqa: BLE001  the case is tried again, then a row of zeros
        return CaseResult(row=None, error=one_line(f"{type(error).__name__}: {error}", 200))
