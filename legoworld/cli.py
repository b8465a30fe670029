"""The command line. Commands import what they need when they run: --help stays quick."""

from __future__ import annotations

import atexit
import os
import sys
import threading
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn

import click

from legoworld import __version__, exit_codes
from legoworld.commands.terminal import printable_streams
from legoworld.errors import LegoWorldError
from legoworld.pluralize import did_you_mean

_COMMANDS = {
    "execute": "run a scene program in its own process and export the scene",
    "blender": "a headless Blender that coding agents drive",
    "freeze": "check scene artefacts and put their hashes on record",
    "inspect": "what is in one scene: instances, buffers, overlay",
    "track": "make a public track from annotations, or check one",
    "readout": "read labels out of scenes into a run folder",
    "merge": "the shards of a run, put together",
    "baseline": "run a specialist model, or import anyone's results, as a run",
    "export": "a run's boxes or masks as one COCO file for dataset tools",
    "evaluate": "score a run against private truth",
    "score": "one program or scene against one photo's ground truth, in one step",
    "evidence": "re-check an evaluation's or a comparison's hashes and numbers",
    "compare": "two evaluations side by side, over the same images",
    "report": "one HTML page of evaluations and comparisons",
    "list": "tasks, datasets and what else can be named",
    "doctor": "check that this machine has what legoworld needs",
}


#: What Ctrl-C leaves behind, of the commands that keep more than nothing.
_AFTER_CTRL_C = {
    "readout": "what was read is kept; run the same command again to resume",
    "baseline run": "what was predicted is kept; run the same command again to resume",
    "freeze": "the records made so far are kept; run the same command again to make the others",
}


class LazyGroup(click.Group):
    """Subcommands in modules of their own, imported when used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands in the order they are used."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of a command."""
        if cmd_name not in _COMMANDS:
            return None
        command = import_module(f"legoworld.commands.{cmd_name}_command").command
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is called; of a misspelt one, an error that names the nearest."""
        if args and args[0] not in _COMMANDS and not args[0].startswith("-"):
            ctx.fail(f"No such command {args[0]!r}.{did_you_mean(args[0], list(_COMMANDS))}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List commands without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


@click.command(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="legoworld")
def main() -> None:
    """Read vision labels out of frozen Blender scenes, and score them.

    \b
    Examples:
      legoworld readout --task coco                       the examples that ship with the package
      legoworld readout SCENES --task coco --track TRACK.json -o RUN
      legoworld inspect SCENE --photo photo.jpg -o LOOK
    """


def run(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit code; what it prints cannot command a terminal."""
    with printable_streams():
        return _run(arguments)


def _run(arguments: list[str] | None) -> int:
    """Run a command and return its exit code (`exit_codes`): the one place that chooses it.

    A foreseen error is one line on standard error. Any other is a defect of legoworld: its
    traceback is shown, and never taken for a finished command.
    """
    words = sys.argv[1:] if arguments is None else arguments
    try:
        result: Any = main.main(words, prog_name="legoworld", standalone_mode=False)
    except click.exceptions.Exit as done:
        return done.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo(f"legoworld: stopped; {_after_ctrl_c(words)}", err=True)
        return exit_codes.INTERRUPTED
    except click.ClickException as error:
        error.show()
        return exit_codes.UNUSABLE
    except LegoWorldError as error:
        if error.trace and {"-v", "--verbose"} & {*words}:
            click.echo(error.trace.rstrip(), err=True)
        click.echo(f"legoworld: {error}", err=True)
        return error.exit_code
    except SystemExit as ended:
        # click's own: 0 of shell completion, 1 where nobody reads the output any more.
        return exit_codes.BLOCKED if ended.code else exit_codes.DONE
    except OSError as error:
        click.echo(f"legoworld: {_refused(error)}", err=True)
        return exit_codes.of_os_error(error)
    except Exception:  # noqa: BLE001  shown whole; Python's own exit code 1 means something else
        traceback.print_exc()
        click.echo(
            "legoworld: a defect of legoworld, not of what it was given; next: report it with the "
            "lines above",
            err=True,
        )
        return exit_codes.BLOCKED
    return result if isinstance(result, int) else exit_codes.DONE


def _after_ctrl_c(words: Sequence[str]) -> str:
    """What is left, and what the same command does with it."""
    names = (" ".join(words[:2]), *words[:1])
    known = next((_AFTER_CTRL_C[name] for name in names if name in _AFTER_CTRL_C), None)
    return known or "nothing was finished; run the same command again to start over"


def _refused(error: OSError) -> str:
    where = f" {error.filename}" if error.filename else ""
    return (
        f"the system refused{where}: {error.strerror or error}; what was done is kept; "
        "next: correct the cause and run the same command again"
    )


def entry() -> None:
    """The `legoworld` program."""
    _leave(run())


def _leave(code: int) -> NoReturn:
    """End the process without taking the interpreter apart first.

    All is written by then; taking numpy apart costs a tenth of a cached readout. Where somebody
    listens to the end (a thread, a profiler, a reader that is gone), it is Python's usual one.
    """
    if threading.active_count() > 1 or sys.getprofile() or sys.gettrace():
        sys.exit(code)
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        sys.exit(code)
    os._exit(code)
