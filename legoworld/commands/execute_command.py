"""`legoworld execute`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.options import off, option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FILE, WRITTEN

if TYPE_CHECKING:
    from legoworld.records.scene_folder import ExecutionFile


@click.command("execute")
@click.argument("program", type=EXISTING_FILE)
@option("--output", "Scene folder to write, or a .blend or .glb to write alone.", WRITTEN)
@off("--no-picture picture", "Do not render final.png.")
@option("--input", "File or folder the program may read; repeatable.")
@option("--sandbox")
@options.limits
@options.printing
def command(program: Path, output: Path, out: Output, **given: Any) -> int:
    """Run a scene PROGRAM in its own process; export scene.blend, scene.glb and final.png.

    The program starts in an empty folder with Blender's start-up scene. Its own render calls are
    skipped. If it stops with an error, the partial scene is still exported, execution.json records
    the line and the error, and the exit code is 1. It is 5 when the exported scene cannot be read.

    A program is untrusted code. With bubblewrap it has no network, writes only to its own empty
    folder and reads none of your files except PROGRAM and each --input. Without bubblewrap its
    environment variables, time, memory, output and child processes are limited, but it can read and
    write everything you can. execution.json records which protections were active.

    \b
    Examples:
      legoworld execute scene.py -o scenes/000000000139
      legoworld execute scene.py -o scenes/coffee --time-limit 600
      legoworld execute scene.py -o kitchen.blend
      legoworld execute scene.py -o scenes/room --input textures --sandbox bubblewrap
    """
    from legoworld.api.scene_folders import execute

    result = execute(program, output, listener=out.listener(), **given)
    out.show(
        {"status": result.status, "error": result.error, "files": list(result.files),
         "warnings": list(result.warnings), "check": result.check, "sandbox": result.sandbox},
        _lines(result, program, output, out),
    )  # fmt: skip
    if result.check and result.check.status != "ok":
        return exit_codes.NOT_ASSESSED
    return exit_codes.INCOMPLETE if result.error else exit_codes.DONE


def _lines(result: ExecutionFile, program: Path, output: Path, out: Output) -> Iterator[str]:
    for warning in result.warnings:
        out.notice(f"warning: {warning}")
    if result.error:
        where = f"line {result.error.line}" if result.error.line else "outside its own lines"
        yield (
            f"stopped: {program.name}, {where}: {result.error.type}: "
            f"{result.error.message}; the partial scene was exported"
        )
    yield f"{', '.join(result.files)} -> {output}"
