"""`legoworld execute`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import options
from legoworld.commands.options import off, option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FILE, WRITTEN

if TYPE_CHECKING:
    from legoworld.records.execution import ExecutionFile
    from legoworld.scene.blender_process import Limits
    from legoworld.workers.protections import Confinement


@click.command("execute")
@click.argument("program", type=EXISTING_FILE)
@option("--output", "Scene folder to write, or a .blend or .glb to write alone.", WRITTEN)
@off("--no-picture picture", "Do not render final.png.")
@option("--input", "File or folder the program may read; repeatable.")
@option("--sandbox")
@options.limits
@options.printing
def command(
    program: Path,
    output: Path,
    picture: bool,
    inputs: tuple[Path, ...],
    sandbox: Confinement,
    limits: Limits,
    out: Output,
) -> int:
    """Run a scene PROGRAM in its own process; export scene.blend, scene.glb and final.png.

    The program starts in an empty folder with Blender's start-up scene. Its own render calls are
    skipped. If it stops with an error, the partial scene is still exported, execution.json records
    the line and the error, and the exit code is 1.

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
    from legoworld.scene.programs.execution import execute
    from legoworld.workers.protections import protections

    if output.is_file() and output.suffix.lower() not in (".blend", ".glb"):
        raise click.UsageError(f"-o {output} is a file, and no .blend or .glb")
    held = protections(sandbox)
    if held.bubblewrap is None:
        out.notice(
            f"warning: without bubblewrap ({held.why_not}) the program runs with your permissions; "
            f"limited: {', '.join(held.holds)}; not limited: {', '.join(held.does_not_hold)}"
        )
    result = execute(
        program, output, limits=limits, picture=picture, sandbox=sandbox, inputs=inputs,
        notice=out.notice,
    )  # fmt: skip
    out.show(
        {"status": result.status, "error": result.error, "files": list(result.files),
         "warnings": list(result.warnings), "check": result.check, "sandbox": result.sandbox},
        _lines(result, program, output, out),
    )  # fmt: skip
    return 1 if result.error else 0


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
