"""`legoworld freeze`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FOLDER
from legoworld.commands.progress import shown_progress
from legoworld.errors import name_on_line
from legoworld.pluralize import plural, share

if TYPE_CHECKING:
    from legoworld.records.scene_folder import FrozenRow


@click.command("freeze")
@click.argument("scenes", type=EXISTING_FOLDER)
@option("--workers")
@option("--engine")
@options.cache
@options.limits
@options.printing
def command(scenes: Path, out: Output, **given: Any) -> int:
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
    from legoworld.api.scene_folders import freeze

    with shown_progress("scene", quiet=out.quiet) as listener:
        rows = freeze(scenes, listener=listener, **given)
    bad = [row for row in rows if row.status != "ok"]
    out.show({"scenes": rows}, _lines(rows, bad, out))
    return 1 if bad else 0


def _lines(rows: list[FrozenRow], bad: list[FrozenRow], out: Output) -> Iterator[str]:
    for row in () if out.quiet else rows:
        for warning in row.warnings:
            yield f"warning: {name_on_line(row.scene)}: {warning}"
    for row in rows:
        scene = name_on_line(row.scene)
        if row.status == "ok" and (not out.verbose or out.quiet):
            continue
        if row.status == "ok":
            yield f"ok: {scene}"
        for name, check in row.checks.items():
            if check.status != "ok":
                yield f"{check.status}: {scene}/{name}: {check.reason}"
    frozen = share(len(rows) - len(bad), len(rows), "scene", "scenes")
    failed = plural(len(bad), "scene fails a check", "scenes fail a check")
    yield f"{frozen} frozen, {failed if bad else 'all checks passed'}"
