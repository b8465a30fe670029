"""The command line. Commands import what they need when they run: --help stays quick."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Any

import click

from legoworld import __version__
from legoworld.errors import LegoWorldError, UsageError

_COMMANDS = {
    "execute": "run a scene program in its own process and export the scene",
    "freeze": "check scene artefacts and put their hashes on record",
    "inspect": "what is in one scene: instances, buffers, overlay",
    "track": "make a public track from annotations, or check one",
    "readout": "read labels out of scenes into a run folder",
    "merge": "the shards of a run, put together",
    "baseline": "run a specialist model, or import anyone's results, as a run",
    "evaluate": "score a run against private truth",
    "evidence": "re-check an evaluation's or a comparison's hashes and numbers",
    "compare": "two evaluations side by side, over the same images",
    "report": "one HTML page of evaluations and comparisons",
    "list": "tasks, datasets and what else can be named",
    "doctor": "check that this machine has what legoworld needs",
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
    """Run a command; every foreseen error is one line on standard error and an exit code."""
    try:
        result: Any = main.main(arguments, prog_name="legoworld", standalone_mode=False)
    except click.exceptions.Exit as done:
        return done.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("legoworld: stopped; the same command again goes on from what is done", err=True)
        return 130
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except UsageError as error:
        click.echo(f"legoworld: {error}", err=True)
        return 2
    except LegoWorldError as error:
        click.echo(f"legoworld: {error}", err=True)
        return 1
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        click.echo(
            f"legoworld: the system refused{where}: {error.strerror or error}; what was done is "
            "kept; next: correct the cause and run the same command again",
            err=True,
        )
        return 1
    return result if isinstance(result, int) else 0


def entry() -> None:
    """The `legoworld` program."""
    sys.exit(run())
