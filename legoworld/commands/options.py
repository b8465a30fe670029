"""Shared command-line options, and how results and notices are printed."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import escaped
from legoworld.pluralize import did_you_mean
from legoworld.tables.table import Cell
from legoworld.tables.table import table as of_cells
from legoworld.tables.terminal import terminal
from legoworld.tasks.registry import known_tasks, task_named, task_names
from legoworld.tasks.task import Task

if TYPE_CHECKING:
    from legoworld.records.base import Storable

F = TypeVar("F", bound=Callable[..., Any])

FOLDER = click.Path(path_type=Path, file_okay=False)
EXISTING_FOLDER = click.Path(path_type=Path, file_okay=False, exists=True)
EXISTING_FILE = click.Path(path_type=Path, dir_okay=False, exists=True)


class Choice(click.Choice[str]):
    """A choice of words; for a misspelt one the error suggests the nearest."""

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """The word as it is spelled in the list."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            near = did_you_mean(str(value), list(self.choices))
            self.fail(f"{error.message.rstrip('.')}.{near}", param, ctx)


class TaskChoice(Choice):
    """The name of a task that a command can serve; the list is asked for when it is needed."""

    def __init__(self, serves: Callable[[Task], bool] = lambda _task: True) -> None:
        super().__init__(())
        self._serves = serves

    @property  # asked for with --help or a name, not when the command is defined
    def choices(self) -> tuple[str, ...]:
        """The names, those that ship first."""
        return tuple(task.name for task in known_tasks() if self._serves(task))

    @choices.setter
    def choices(self, _unused: object) -> None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Set by click alone."""

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """The name. InstallationError for a task of a package that cannot be loaded."""
        if str(value) in task_names():
            task_named(str(value))
        return super().convert(value, param, ctx)


def has_track(task: Task) -> bool:
    """Whether tracks of the task are made from truth."""
    return task.family.track is not None


class SizeType(click.ParamType[tuple[int, int]]):
    """WIDTHxHEIGHT in pixels."""

    name = "WxH"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Text to (width, height)."""
        if isinstance(value, tuple):
            return value
        parts = str(value).lower().split("x")
        if len(parts) != 2 or not all(p.isdigit() and 0 < int(p) <= 8192 for p in parts):
            self.fail(f"{value!r} is not a size such as 640x480", param, ctx)
        return int(parts[0]), int(parts[1])


class ShardType(click.ParamType[tuple[int, int]]):
    """i/n, counted from 1."""

    name = "i/n"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Text to (index, number of shards)."""
        if isinstance(value, tuple):
            return value
        parts = str(value).split("/")
        if len(parts) != 2 or not all(p.isdecimal() for p in parts):
            self.fail(f"{value!r} is not a shard such as 1/16", param, ctx)
        index, of = int(parts[0]), int(parts[1])
        if not 1 <= index <= of:
            self.fail(
                f"{value!r}: shards are counted from 1/{of or 1} to {of or 1}/{of or 1}", param, ctx
            )
        return index, of


def limits(command: F) -> F:
    """--time-limit and --memory-limit of each Blender process."""
    command = click.option(
        "--time-limit",
        default=120.0,
        show_default=True,
        type=click.FloatRange(min=0.1),
        envvar="LEGOWORLD_TIME_LIMIT",
        help="Time limit of Blender per scene, in seconds.",
    )(command)
    return click.option(
        "--memory-limit",
        default=8.0,
        show_default=True,
        type=click.FloatRange(min=0.1),
        envvar="LEGOWORLD_MEMORY_LIMIT",
        help="Memory limit of one Blender process, in GiB.",
    )(command)


def source(command: F) -> F:
    """--source."""
    return click.option(
        "--source",
        type=Choice(["blend", "glb"]),
        default="blend",
        show_default=True,
        help="File of a scene to read.",
    )(command)


def engine(command: F) -> F:
    """--engine."""
    return click.option(
        "--engine",
        type=Choice(["local", "ray"]),
        default="local",
        show_default=True,
        envvar="LEGOWORLD_ENGINE",
        help="Run on this machine or on a Ray cluster (RAY_ADDRESS).",
    )(command)


def caching(command: F) -> F:
    """--cache and --no-cache."""
    command = click.option(
        "--cache",
        type=FOLDER,
        envvar="LEGOWORLD_CACHE",
        help="Snapshot cache folder [default: the user's cache folder].",
    )(command)
    return click.option(
        "--no-cache",
        is_flag=True,
        help="Neither read nor write the snapshot cache; overrides --cache.",
    )(command)


def output_options(command: F) -> F:
    """--json, -q and -v."""
    command = click.option(
        "--json", "as_json", is_flag=True, help="Print one JSON document instead of tables."
    )(command)
    command = click.option("-q", "--quiet", is_flag=True, help="Print no progress and no notices.")(
        command
    )
    return click.option("-v", "--verbose", is_flag=True, help="Print full details.")(command)


def cache_choice(cache: Path | None, no_cache: bool) -> bool | Path:
    """--cache and --no-cache as the Python API's `cache` argument; --no-cache wins.

    A cache that nobody chose and that cannot be written is left out, and a notice says so.
    """
    if no_cache or cache:
        return False if no_cache else cache or True
    from legoworld.scene.cache import default_cache_folder, why_unwritable

    folder = default_cache_folder()
    why = why_unwritable(folder)
    if why:
        click.echo(
            f"the snapshot cache {folder} cannot be written ({why}): continuing without one; "
            "--cache DIR or LEGOWORLD_CACHE chooses another place, --no-cache none",
            err=True,
        )
    return not why


def refuse_given(names: Sequence[str], why: str) -> None:
    """Raise click.UsageError when one of these options was given, so that none is ignored."""
    context = click.get_current_context()
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is click.core.ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{parameter.opts[0]} {why}")


def print_json(document: Mapping[str, Storable]) -> None:
    """Print one JSON document with schema_version on standard output; records are converted."""
    from legoworld.records.base import as_json

    whole = {"schema_version": SCHEMA_VERSION, **document}
    text = json.dumps(whole, sort_keys=True, ensure_ascii=False, default=as_json)
    click.echo(escaped(text))


def table(header: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    """A text table of words and numbers."""
    return terminal(of_cells(header, rows))


def report_hint(folder: Path, *, photos: bool) -> str:
    """The last line of what evaluate and compare print: how to look at the result.

    photos: whether the page has to be told where they are; a bench's are found without.
    """
    more = " --photos PHOTOS" if photos else ""
    return f"look at it: legoworld report {shlex.quote(str(folder))}{more} -o report.html"


def notifier(quiet: bool) -> Callable[[str], None]:
    """A function that prints a notice on standard error, unless --quiet."""

    def notice(text: str) -> None:
        if not quiet:
            click.echo(text, err=True)

    return notice


def tracer(verbose: bool) -> Callable[[str], None]:
    """A function that prints a traceback on standard error with --verbose, regardless of -q."""
    return notifier(quiet=not verbose)


def on_terminal() -> bool:
    """Whether standard error is a terminal."""
    return sys.stderr.isatty()
