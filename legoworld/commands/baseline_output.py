"""Code shared by `baseline run` and `baseline import`: the track, the labels, printing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import options
from legoworld.pluralize import counted, share
from legoworld.records.base import UNSET

if TYPE_CHECKING:
    from legoworld.baselines.confinement import Confined
    from legoworld.readouts.protocol import Protocol
    from legoworld.records.run_rows import RunRow
    from legoworld.running.readout_run import RunResult
    from legoworld.tables.table import Cell
    from legoworld.tracks.track import Track

sandbox_option = click.option(
    "--sandbox",
    type=options.Choice(["auto", "bubblewrap", "limits"]),
    default="auto",
    show_default=True,
    help="auto: bubblewrap where it works; bubblewrap: fail without it; limits: never.",
)
TASKS = options.TaskChoice(lambda task: task.family.baseline is not None)


def track_of(task: str, track: Path) -> tuple[Track, Protocol]:
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


def warn_unconfined(confined: Confined, notice: Callable[[str], None]) -> None:
    """Say what a baseline's process is not kept from where there is no bubblewrap."""
    if confined.held.bubblewrap is None:
        missing = ", ".join(confined.record().does_not_hold)
        notice(
            f"warning: without bubblewrap ({confined.held.why_not}) the baseline runs with your "
            f"permissions; not kept from it: {missing}"
        )


def show(result: RunResult, output: Path, *, as_json: bool, verbose: bool) -> int:
    """Print the contents of the run; return the exit code."""
    bad = [row for row in result.rows if row.status != "ok"]
    if as_json:
        options.print_json({"run": str(output), "summary": result.summary, "rows": result.rows})
    else:
        _print(result, bad, output, verbose=verbose)
    return 1 if bad else 0


def _print(result: RunResult, bad: list[RunRow], output: Path, *, verbose: bool) -> None:
    summary = result.summary
    if verbose:
        cells = [(row.image_id, row.file_name, row.status, _made(row)) for row in result.rows]
        click.echo(options.table(("image", "photo", "status", "predicted"), cells) + "\n")
    for row in bad[:50]:
        click.echo(f"{row.status}: {row.file_name} (image {row.image_id}): {row.reason}")
    if len(bad) > 50:
        click.echo(f"... and {len(bad) - 50} more, in {output / 'per_image.jsonl'}")
    from legoworld.cards import load_card

    coverage = summary.coverage
    line = f"{share(coverage.ok, coverage.attempted, 'image', 'images')} predicted"
    if coverage.ok_empty is not UNSET:
        what = ("box", "boxes") if load_card(summary.task).reads == "boxes" else ("mask", "masks")
        made = counted(summary.predictions or 0, *what)
        line += f" ({coverage.ok_empty} without any), {made}"
    if summary.partial:
        line += ", partial run"
    click.echo(f"{line} -> {output}")


def _made(row: RunRow) -> Cell:
    if row.status != "ok":
        return "-"
    if row.depth and row.rendered_wh:
        width, height = row.rendered_wh
        return f"{row.depth.finite_px / (width * height):.1%} {row.depth.space}"
    return row.n_predictions or 0
