"""Shared by `baseline run` and `baseline import`: the task, the track, the labels, printing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands.options import Decorator, option
from legoworld.commands.output import Output, table
from legoworld.commands.param_types import TaskChoice
from legoworld.pluralize import plural, share
from legoworld.records.base import UNSET
from legoworld.tasks.task import Task

if TYPE_CHECKING:
    from legoworld.baselines.confinement import BaselineConfinement
    from legoworld.readouts.protocol import Protocol
    from legoworld.records.run_rows import RunRow
    from legoworld.running.readout_run import RunResult
    from legoworld.tables.table import Cell
    from legoworld.tracks.track import Track


def _has_baseline(task: Task) -> bool:
    return task.family.baseline is not None


def task(text: str) -> Decorator:
    """--task of a baseline."""
    return option("--task", text, TaskChoice(_has_baseline), required=True)


def load_track_and_protocol(task: str, track: Path) -> tuple[Track, Protocol]:
    """The track and its task's protocol; click.UsageError for a track of another task."""
    from legoworld.readouts.protocol import protocol
    from legoworld.tracks.track import load_track, serves

    images = load_track(track)
    if not serves(images, task):
        raise click.UsageError(
            f"the track was made for {images.made_for}, not for {task}: make one with "
            f"`legoworld track make --task {task}`"
        )
    return images, protocol(task, images.vocabulary)


def labels(path: Path | None, protocol: Protocol) -> dict[str, str | None]:
    """The model's labels mapped to category names: the known ones and those of --label-map."""
    from legoworld.baselines.labels import label_map

    if protocol.vocabulary is None:
        if path is not None:
            raise click.UsageError("--label-map is for boxes and masks: depth has no labels")
        return {}
    return label_map(path, protocol.vocabulary, protocol.task.name)


def warn_unconfined(confined: BaselineConfinement, notice: Callable[[str], None]) -> None:
    """Say what a baseline's process is not kept from where there is no bubblewrap."""
    if confined.held.bubblewrap is None:
        missing = ", ".join(confined.record().does_not_hold)
        notice(
            f"warning: without bubblewrap ({confined.held.why_not}) the baseline runs with your "
            f"permissions; not kept from it: {missing}"
        )


def show(result: RunResult, output: Path, out: Output) -> int:
    """Print the contents of the run; return the exit code."""
    bad = [row for row in result.rows if row.status != "ok"]
    out.show(
        {"run": str(output), "summary": result.summary, "rows": result.rows},
        _lines(result, bad, output, verbose=out.verbose),
    )
    return 1 if bad else 0


def _lines(result: RunResult, bad: list[RunRow], output: Path, *, verbose: bool) -> Iterator[str]:
    summary = result.summary
    if verbose:
        cells = [
            (row.image_id, row.file_name, row.status, _result_cell(row)) for row in result.rows
        ]
        yield table(("image", "photo", "status", "predicted"), cells) + "\n"
    for row in bad[:50]:
        yield f"{row.status}: {row.file_name} (image {row.image_id}): {row.reason}"
    if len(bad) > 50:
        yield f"... and {len(bad) - 50} more, in {output / 'per_image.jsonl'}"
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
    yield f"{line} -> {output}"


def _result_cell(row: RunRow) -> Cell:
    if row.status != "ok":
        return "-"
    if row.depth and row.rendered_wh:
        width, height = row.rendered_wh
        return f"{row.depth.finite_px / (width * height):.1%} {row.depth.space}"
    return row.n_predictions or 0
