"""`legoworld execute`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from legoworld.commands import options


@click.command("execute", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("program", type=options.EXISTING_FILE)
@click.option("-o", "--output", type=options.FOLDER, required=True, help="The scene folder.")
@click.option("--no-picture", is_flag=True, help="Do not render final.png.")
@click.option(
    "--input",
    "inputs",
    multiple=True,
    type=click.Path(path_type=Path, exists=True),
    help="A file or folder the program may read; repeat.",
)
@click.option(
    "--sandbox",
    type=options.Choice(["auto", "bubblewrap", "limits"]),
    default="auto",
    show_default=True,
    help="auto: bubblewrap where it works, limits alone elsewhere; bubblewrap: or fail.",
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
    skipped. One that stops with an error is still exported with what it had built, marked in
    execution.json with the line and the error; exit code 1 then.

    A program is code. With bubblewrap it has no network, writes to its own empty folder and reads
    nothing of yours but PROGRAM and each --input. Without it, environment variables, time, memory,
    output and the processes it starts are limited, but it reads and writes what you can. Which of
    these held is in execution.json.

    \b
    Examples:
      legoworld execute scene.py -o scenes/000000000139
      legoworld execute scene.py -o scenes/coffee --time-limit 600
      legoworld execute scene.py -o scenes/room --input textures --sandbox bubblewrap
    """
    from legoworld.api.settings import limits_of
    from legoworld.scene.programs.execution import execute
    from legoworld.workers.sandbox import protections

    notice = options.notifier(quiet)
    held = protections(sandbox)
    if held.bubblewrap is None:
        notice(
            f"warning: without bubblewrap ({held.why_not}) the program runs with your rights; "
            f"limited: {', '.join(held.holds)}; not limited: {', '.join(held.does_not_hold)}"
        )
    result = execute(
        program,
        output,
        limits=limits_of(time_limit, memory_limit),
        picture=not no_picture,
        sandbox=sandbox,
        inputs=inputs,
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
            where = f"line {result.error.line}" if result.error.line else "no line of its own"
            click.echo(
                f"stopped: {program.name}, {where}: {result.error.type}: "
                f"{result.error.message}; what it had built was exported"
            )
        click.echo(f"{', '.join(result.files)} -> {output}")
    return 1 if result.error else 0
