"""`legoworld execute`."""

from __future__ import annotations

from pathlib import Path

import click

from legoworld.commands import options


@click.command("execute", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("program", type=options.EXISTING_FILE)
@click.option("-o", "--output", type=options.FOLDER, required=True, help="The scene folder.")
@click.option("--no-picture", is_flag=True, help="Do not render final.png.")
@options.limits
@options.output_options
def command(
    program: Path,
    output: Path,
    no_picture: bool,
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

    A program is code: it can do whatever you can do. Run programs you do not trust in a container.

    \b
    Examples:
      legoworld execute scene.py -o scenes/000000000139
      legoworld execute scene.py -o scenes/coffee --time-limit 600
    """
    from legoworld.scene.execution import execute

    notice = options.notifier(quiet)
    notice("warning: a program is code and runs with your rights; only time and memory are limited")
    result = execute(
        program,
        output,
        limits=options.chosen_limits(time_limit, memory_limit),
        picture=not no_picture,
    )
    if as_json:
        options.print_json(
            {
                "status": result.status,
                "error": result.error,
                "files": list(result.files),
                "warnings": list(result.warnings),
            }
        )
    else:
        for warning in result.warnings:
            notice(f"warning: {warning}")
        if result.error:
            where = f"line {result.error['line']}" if result.error["line"] else "no line of its own"
            click.echo(
                f"stopped: {program.name}, {where}: {result.error['type']}: "
                f"{result.error['message']}; what it had built was exported"
            )
        click.echo(f"{', '.join(result.files)} -> {output}")
    return 1 if result.error else 0
