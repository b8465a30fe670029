"""`legoworld freeze`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from legoworld.commands import options
from legoworld.commands.progress import shown_progress
from legoworld.errors import name_on_line
from legoworld.pluralize import counted, share

if TYPE_CHECKING:
    from legoworld.records.frozen import FrozenRow


@click.command("freeze", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("scenes", type=options.EXISTING_FOLDER)
@click.option("--workers", type=click.IntRange(min=1), help="Blender processes [default: cores].")
@options.engine
@options.caching
@options.limits
@options.output_options
def command(
    scenes: Path,
    workers: int | None,
    engine: Literal["local", "ray"],
    cache: Path | None,
    no_cache: bool,
    time_limit: float,
    memory_limit: float,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Check every scene below SCENES and write its frozen.json.

    Checks: scene.blend opens in Blender with a camera and a surface; scene.glb, if present, is
    well-formed; final.png, if present, decodes and is not a single flat colour. The sha256 of
    these, of scene.py and labels.json, and of every file the .blend reads are recorded. Exit code 1
    when an artefact fails its check.

    \b
    Examples:
      legoworld freeze scenes
      legoworld freeze scenes/000000000139 --json
    """
    from legoworld.api.settings import limits_of, snapshot_cache
    from legoworld.records.run_rows import RunRow
    from legoworld.running.freeze_run import freeze_scenes
    from legoworld.workers.engines import engine_cores

    with shown_progress("scene", quiet=quiet) as listener:
        rows = freeze_scenes(
            scenes,
            engine=engine,
            workers=workers or engine_cores(engine),
            cache=snapshot_cache(options.cache_choice(cache, no_cache)),
            limits=limits_of(time_limit, memory_limit),
            total=listener.total,
            row=lambda row: listener.row(
                RunRow(image_id=0, file_name=row.scene, status=row.status)
            ),
        )
    bad = [row for row in rows if row.status != "ok"]
    if as_json:
        options.print_json({"scenes": rows})
    else:
        _print(rows, bad, quiet=quiet, verbose=verbose)
    return 1 if bad else 0


def _print(rows: list[FrozenRow], bad: list[FrozenRow], *, quiet: bool, verbose: bool) -> None:
    for row in () if quiet else rows:
        for warning in row.warnings:
            click.echo(f"warning: {name_on_line(row.scene)}: {warning}")
    for row in rows:
        scene = name_on_line(row.scene)
        if row.status == "ok" and (not verbose or quiet):
            continue
        if row.status == "ok":
            click.echo(f"ok: {scene}")
        for name, check in row.checks.items():
            if check.status != "ok":
                click.echo(f"{check.status}: {scene}/{name}: {check.reason}")
    frozen = share(len(rows) - len(bad), len(rows), "scene", "scenes")
    failed = counted(len(bad), "scene fails a check", "scenes fail a check")
    click.echo(f"{frozen} frozen, {failed if bad else 'all checks passed'}")
