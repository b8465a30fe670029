"""`legoworld execute`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from legoworld.commands import options


@click.command("execute", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("program", type=options.EXISTING_FILE)
@click.option("-o", "--output", type=options.FOLDER, required=True, help="Scene folder to write.")
@click.option("--no-picture", is_flag=True, help="Do not render final.png.")
@click.option(
    "--input",
    "inputs",
    multiple=True,
    type=click.Path(path_type=Path, exists=True),
    help="File or folder the program may read; repeatable.",
)
@click.option(
    "--sandbox",
    type=options.Choice(["auto", "bubblewrap", "limits"]),
    default="auto",
    show_default=True,
    help="auto: bubblewrap where it works, otherwise limits only; bubblewrap: fail without it.",
)
@options.limits
@options.output_options
def command(
    program: Path,
    output: Path,
    no_picture: bool,
    inputs: tuple[Path, ...],
    sandbox: Literal["auto", "bubblewrap", "limits"],
    time_limit: float,
    memory_limit: float,
    as_json: bool,
    quiet: bool,
    verbose: bool,
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
      legoworld execute scene.py -o scenes/room --input textures --sandbox bubblewrap
    """
    from legoworld.api.settings import limits_of
    from legoworld.scene.programs.execution import execute
    from legoworld.workers.protections import protections

    notice = options.notifier(quiet)
    held = protections(sandbox)
    if held.bubblewrap is None:
        notice(
            f"warning: without bubblewrap ({held.why_not}) the program runs with your permissions; "
            f"limited: {', '.join(held.holds)}; not limited: {', '.join(held.does_not_hold)}"
        )
    result = execute(
        program,
        output,
        limits=limits_of(time_limit, memory_limit),
        picture=not no_picture,
        sandbox=sandbox,
        inputs=inputs,
        notice=notice,
    )
    if as_json:
        options.print_json(
            {
                "status": result.status,
                "error": result.error,
                "files": list(result.files),
                "warnings": list(result.warnings),
                "check": result.check,
                "sandbox": result.sandbox,
            }
        )
    else:
        for warning in result.warnings:
            notice(f"warning: {warning}")
        if result.error:
            where = f"line {result.error.line}" if result.error.line else "outside its own lines"
            click.echo(
                f"stopped: {program.name}, {where}: {result.error.type}: "
                f"{result.error.message}; the partial scene was exported"
            )
        click.echo(f"{', '.join(result.files)} -> {output}")
    return 1 if result.error else 0
