"""The command line. Commands import what they need when they run: --help stays quick."""

from __future__ import annotations

import atexit
import contextlib
import faulthandler
import os
import sys
import threading
import traceback
import warnings
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

import click

from legoworld import exit_codes
from legoworld.commands.terminal import printable_streams
from legoworld.errors import LegoWorldError
from legoworld.pluralize import did_you_mean
from legoworld.version import __version__

_COMMANDS = {
    "execute": "run a scene program in its own process and export the scene",
    "plugin": "measure a live scene against a photo, guard edits to it",
    "blender": "run a headless Blender that coding agents drive",
    "agent": "list the coding agents that can be run, and check what they need",
    "reconstruct": "rebuild photos as frozen scenes, by an agent in Blender",
    "trajectory": "show and score what happened on the way to each scene",
    "freeze": "check scene artefacts and record their hashes",
    "inspect": "show one scene: instances, buffers, overlay",
    "track": "make a public track from annotations, or check one",
    "readout": "read labels out of scenes into a run folder",
    "bench": "make LEGO-Bench cases from reference scenes, and use them",
    "merge": "join the shards of a run",
    "baseline": "run a specialist model, or import results, as a run",
    "export": "write runs and scenes in the formats of other tools",
    "import": "import a USD file as a scene folder",
    "evaluate": "score a run against private ground truth",
    "score": "score one program or scene against one photo's ground truth",
    "evidence": "verify the hashes and numbers of an evaluation or a comparison",
    "compare": "compare two evaluations over the same images",
    "report": "write one HTML page of evaluations and comparisons",
    "view": "watch runs, trials and results in a browser, while they go on",
    "list": "list tasks, datasets, baselines and file formats, or print the authoring guide",
    "demo": "read out, score and report the shipped examples",
    "doctor": "check that this machine has what legoworld needs",
}


#: What each command keeps after Ctrl-C, for the commands that keep anything.
_AFTER_CTRL_C = {
    "readout": "finished images are kept; run the same command again to resume",
    "baseline run": "finished images are kept; run the same command again to resume",
    "bench make": "finished renders are kept; run the same command again to resume",
    "reconstruct": "finished trials are kept; run the same command again to resume",
    "trajectory score": "checkpoints read so far are kept; run the same command again to resume",
    "freeze": "records written so far are kept; run the same command again to freeze the rest",
}


class LazyGroup(click.Group):
    """Subcommands, each in its own module, imported on first use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands in workflow order."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command's module and return the command."""
        if cmd_name not in _COMMANDS:
            return None
        command = import_module(f"legoworld.commands.{cmd_name}_command").command
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Resolve a command name; a misspelt name is an error that suggests the nearest."""
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
      legoworld readout --task coco                       the shipped examples
      legoworld readout SCENES --task coco --track TRACK.json -o RUN
      legoworld inspect SCENE --photo photo.jpg -o LOOK
    """


def run(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit code; printed text cannot control the terminal."""
    with printable_streams():
        return _run(arguments)


def _run(arguments: list[str] | None) -> int:
    """Run a command and return its exit code (`exit_codes`), which is chosen only here.

    An expected error is one line on standard error. Any other error is a bug in legoworld: its
    traceback is shown, and the command never counts as finished.
    """
    words = sys.argv[1:] if arguments is None else arguments
    try:
        code: int = main.main(words, prog_name="legoworld", standalone_mode=False)
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
        # raised by click: 0 after shell completion, 1 when the output pipe is closed
        return exit_codes.BLOCKED if ended.code else exit_codes.DONE
    except OSError as error:
        click.echo(f"legoworld: {_describe_refusal(error)}", err=True)
        return exit_codes.of_os_error(error)
    except Exception:  # noqa: BLE001  shown whole; Python's own exit code 1 means something else
        traceback.print_exc()
        click.echo(
            "legoworld: internal error, not caused by the input; next: report it with the lines "
            "above",
            err=True,
        )
        return exit_codes.BLOCKED
    return code


def _after_ctrl_c(words: Sequence[str]) -> str:
    """What was kept, and what re-running the command does with it."""
    names = (" ".join(words[:2]), *words[:1])
    known = next((_AFTER_CTRL_C[name] for name in names if name in _AFTER_CTRL_C), None)
    return known or "nothing was kept; run the same command again to start over"


def _describe_refusal(error: OSError) -> str:
    where = f" {error.filename}" if error.filename else ""
    return (
        f"the operating system refused{where}: {error.strerror or error}; finished work is kept; "
        "next: fix the cause and run the same command again"
    )


def entry() -> None:
    """The `legoworld` program."""
    with contextlib.suppress(RuntimeError, OSError, ValueError):  # standard error may be closed
        faulthandler.enable()
    _quiet_arithmetic()
    _leave(run())


def _quiet_arithmetic() -> None:
    """Keep NumPy's warnings of odd numbers from the user, who can do nothing about them.

    What has no value is NaN in results and counted there. Tests turn these warnings into errors,
    and -W or PYTHONWARNINGS shows them.
    """
    if not sys.warnoptions:
        warnings.filterwarnings("ignore", category=RuntimeWarning)


def _leave(code: int) -> NoReturn:
    """End the process without tearing down the interpreter.

    Everything is written by then, and tearing down NumPy costs a tenth of a cached readout. With
    another thread, a profiler or a closed output pipe, the process ends the usual way.
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
