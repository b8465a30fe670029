"""The output of `legoworld readout`: a few lines, or everything with -v."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import click

from legoworld.commands import output
from legoworld.errors import name_on_line
from legoworld.pluralize import first_few, plural, share
from legoworld.records.base import UNSET
from legoworld.tracks.scene_names import Stranger, lower_top

if TYPE_CHECKING:
    from legoworld.api.readout import Run
    from legoworld.records.run_file import RunSummary
    from legoworld.records.run_rows import RunRow
    from legoworld.tables.table import Cell

#: Maximum number of lines of one kind without -v.
_SHORT: Final = 3


def show_runs(results: Mapping[str, Run], *, quiet: bool, verbose: bool) -> None:
    """Print the runs of one pass; what is the same for all of them is printed once."""
    _print_once(
        {task: _lines(result, verbose=verbose) for task, result in results.items()}, err=False
    )
    if not quiet:
        warnings = {
            task: warning_lines(result.rows, verbose=verbose) for task, result in results.items()
        }
        _print_once(warnings, err=True)
    for task, result in results.items():
        prefix = f"{task}: " if len(results) > 1 else ""
        click.echo(f"{prefix}{_counts(result.summary)} -> {result.folder}")


def _print_once(by_task: Mapping[str, Sequence[str]], *, err: bool) -> None:
    """Lines that every task has come first, without a task's name."""
    first, *others = by_task.values()
    common = [line for line in first if all(line in other for other in others)]
    for line in common:
        click.echo(line, err=err)
    for task, lines in by_task.items():
        for line in lines:
            if line not in common:
                click.echo(f"{task}: {line}", err=err)


def _lines(result: Run, *, verbose: bool) -> list[str]:
    """What a run's user may want to change, by kind."""
    return [
        *(_table(result.rows) if verbose else []),
        *failure_lines(result.rows, verbose=verbose),
        *stranger_lines(result.strangers, verbose=verbose),
        *_print_limited(_label_lines(result), "labels outside the vocabulary", verbose=verbose),
        *unlabelled_lines(result),
    ]


def failure_lines(rows: Sequence[RunRow], *, verbose: bool) -> list[str]:
    """One line per kind of failure with its first image; with -v one line per image."""
    failures = [row for row in rows if row.status != "ok"]
    if verbose:
        return [_failure(row) for row in failures]
    kinds: dict[tuple[str, str], list[RunRow]] = {}
    for row in failures:
        what = _kind(str(row.reason).partition(";")[0])
        kinds.setdefault((row.status, what), []).append(row)
    ordered = sorted(kinds.values(), key=lambda rows: -len(rows))
    return [_failure(alike[0], more=len(alike) - 1) for alike in ordered]


def warning_lines(rows: Sequence[RunRow], *, verbose: bool) -> list[str]:
    """The first warning of each kind with the count; with -v every warning.

    Two warnings are of the same kind when they differ only in quoted names and numbers.
    """
    warned = [(row, text) for row in rows for text in row.warnings]
    if verbose:
        return [f"warning: {name_on_line(row.file_name)}: {text}" for row, text in warned]
    kinds: dict[str, list[tuple[RunRow, str]]] = {}
    for row, text in warned:
        kinds.setdefault(_kind(text), []).append((row, text))
    lines = []
    for alike in sorted(kinds.values(), key=lambda found: -len(found)):
        row, text = alike[0]
        images = len({other.image_id for other, _ in alike})
        more = (
            f" ({len(alike)} like it in {plural(images, 'image', 'images')})" if alike[1:] else ""
        )
        lines.append(f"warning: {name_on_line(row.file_name)}: {text}{more}")
    return lines


def _kind(text: str) -> str:
    """A sentence without the parts that differ between scenes: quoted names and numbers."""
    return re.sub(r"'[^']*'|\"[^\"]*\"|\d+(\.\d+)?", "*", text)


def stranger_lines(strangers: Sequence[Stranger], *, verbose: bool) -> list[str]:
    """Scene folders that match no image, and the images they may be meant for."""
    if not strangers:
        return []
    if [s.folder for s in strangers] == ["."]:
        return ["SCENES is itself a scene folder; did you mean its parent folder?"]
    folders = plural(len(strangers), "folder matches", "folders match")
    top = lower_top(strangers)
    if top is not None:
        return [f"{folders} no image of the track; did you mean SCENES/{top}?"]
    shown = strangers if verbose else sorted(strangers, key=lambda s: s.meant is None)
    names = [f"{s.folder!r}" + (f" (did you mean {s.meant!r}?)" if s.meant else "") for s in shown]
    return [
        f"{folders} no image of the track: {first_few(names, len(names) if verbose else _SHORT)}"
    ]


def unlabelled_lines(result: Run) -> list[str]:
    """The number of scenes without any label, from which nothing can be exported."""
    bare = [
        row
        for row in result.rows
        if row.status == "ok"
        and row.instances
        and row.instances.labelled == 0
        and not row.unmatched
        and not row.unexported
    ]
    if not bare:
        return []
    have = plural(len(bare), "scene has", "scenes have")
    first = name_on_line(bare[0].scene)
    task = result.summary.task
    return [
        f"{have} no label, such as {first}: give objects the custom property `category` "
        f"(`legoworld list schema --task {task}`)"
    ]


def _print_limited(lines: Sequence[str], what: str, *, verbose: bool) -> list[str]:
    if verbose or len(lines) <= _SHORT + 1:
        return list(lines)
    return [*lines[:_SHORT], f"... and {len(lines) - _SHORT} more {what} (-v lists them)"]


def _table(rows: Sequence[RunRow]) -> list[str]:
    cells = [
        (row.image_id, row.file_name, row.status, *_exported_cells(row), len(row.warnings))
        for row in rows
    ]
    header = ("image", "photo", "status", "exported", "unexported", "warnings")
    return [output.table(header, cells), ""]


def _failure(row: RunRow, more: int = 0) -> str:
    others = f" and {more} more" if more else ""
    name = name_on_line(row.file_name)
    return f"{row.status}: {name} (image {row.image_id}){others}: {row.reason}"


def _label_lines(result: Run) -> list[str]:
    unmatched = result.summary.unmatched_labels or {}
    ordered = sorted(unmatched.items(), key=lambda item: (-item[1], item[0]))
    return [output.outside_the_vocabulary(name, n, _nearest(result, name)) for name, n in ordered]


def _counts(summary: RunSummary) -> str:
    coverage = summary.coverage
    line = f"{share(coverage.ok, coverage.attempted, 'image', 'images')} read"
    if coverage.ok_empty is not UNSET:
        line += f" ({coverage.ok_empty} without any export)"
    masks = ("mask", "masks")
    boxes = ("box", "boxes")
    kinds = {"boxes": boxes, "boxes_3d": boxes, "masks": masks, "amodal": masks}
    if what := kinds.get(_exports(summary.task)):
        line += f", {plural(summary.predictions or 0, *what)}"
    if summary.validity:
        line += f", {summary.validity.valid} valid"
    if summary.warnings:
        line += f", {plural(summary.warnings, 'warning', 'warnings')}"
    if summary.partial:
        line += ", partial run"
    return line


def _exports(task: str) -> str:
    """boxes, masks, depth or normals."""
    from legoworld.cards import load_card

    return load_card(task).reads


def _exported_cells(row: RunRow) -> tuple[Cell, Cell]:
    if row.status != "ok":
        return "-", "-"
    if row.surface:
        width, height = row.surface.raster_wh
        seen = f"{row.surface.finite_px / (width * height):.1%} surface"
        return (seen if row.valid else f"{seen}, not valid"), "-"
    if (pixels := row.depth or row.normals) and row.rendered_wh:
        width, height = row.rendered_wh
        return f"{pixels.finite_px / (width * height):.1%} {pixels.file.split('/')[0]}", "-"
    return row.n_predictions or 0, len(row.unexported or ())


def _nearest(result: Run, label: str) -> list[str]:
    for row in result.rows:
        for unmatched in row.unmatched or ():
            if unmatched.label == label:
                return list(unmatched.nearest)
    return []
