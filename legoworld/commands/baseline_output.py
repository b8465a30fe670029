"""Shared by `baseline run` and `baseline import`: the task, the track, the labels, printing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from legoworld.commands.options import Decorator, option
from legoworld.commands.output import Output, table
from legoworld.commands.param_types import TaskChoice
from legoworld.pluralize import plural, share
from legoworld.records.base import UNSET
from legoworld.tasks.task import Task

if TYPE_CHECKING:
    from legoworld.api.readout import Run
    from legoworld.records.run_rows import RunRow
    from legoworld.tables.table import Cell


def _has_baseline(task: Task) -> bool:
    return task.family.baseline is not None


def task(text: str) -> Decorator:
    """--task of a baseline."""
    return option("--task", text, TaskChoice(_has_baseline), required=True)


def show(run: Run, out: Output) -> int:
    """Print the contents of the run; return the exit code."""
    bad = [row for row in run.rows if row.status != "ok"]
    out.show(
        {"run": str(run.folder), "summary": run.summary, "rows": run.rows},
        _lines(run, bad, verbose=out.verbose),
    )
    return 1 if bad else 0


def _lines(run: Run, bad: list[RunRow], *, verbose: bool) -> Iterator[str]:
    summary = run.summary
    if verbose:
        cells = [(row.image_id, row.file_name, row.status, _result_cell(row)) for row in run.rows]
        yield table(("image", "photo", "status", "predicted"), cells) + "\n"
    for row in bad[:50]:
        yield f"{row.status}: {row.file_name} (image {row.image_id}): {row.reason}"
    if len(bad) > 50:
        yield f"... and {len(bad) - 50} more, in {run.folder}/per_image.jsonl"
    from legoworld.cards import load_card

    coverage = summary.coverage
    line = f"{share(coverage.ok, coverage.attempted, 'image', 'images')} predicted"
    if coverage.ok_empty is not UNSET:
        boxes = load_card(summary.task).reads.startswith("boxes")
        boxes = load_card(summary.task).reads.startswith("boxes")
        what = ("box", "boxes") if boxes else ("mask", "masks")
        made = plural(summary.predictions or 0, *what)
        line += f" ({coverage.ok_empty} without any), {made}"
    if summary.partial:
        line += ", partial run"
    yield f"{line} -> {run.folder}"


def _result_cell(row: RunRow) -> Cell:
    if row.status != "ok":
        return "-"
    if row.depth and row.rendered_wh:
        width, height = row.rendered_wh
        return f"{row.depth.finite_px / (width * height):.1%} {row.depth.space}"
    return row.n_predictions or 0
