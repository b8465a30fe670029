"""Types of arguments and options: paths, places, words of a list, tasks, sizes, shards."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote, urlsplit

import click

from legoworld.pluralize import did_you_mean
from legoworld.remote import Place, is_url
from legoworld.tasks.registry import known_tasks, require_task, task_names
from legoworld.tasks.task import Task

ParamType = click.ParamType[Any]

FOLDER: Final = click.Path(path_type=Path, file_okay=False)
FILE: Final = click.Path(path_type=Path, dir_okay=False)
WRITTEN: Final = click.Path(path_type=Path)
EXISTING: Final = click.Path(path_type=Path, exists=True)
EXISTING_FOLDER: Final = click.Path(path_type=Path, file_okay=False, exists=True)
EXISTING_FILE: Final = click.Path(path_type=Path, dir_okay=False, exists=True)
#: A count that cannot be 0, or one that can.
COUNT: Final = click.IntRange(min=1)
FROM_ZERO: Final = click.IntRange(min=0)
#: Seconds, or GiB.
AMOUNT: Final = click.FloatRange(min=0.1)


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
            require_task(str(value))
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


class PlaceType(click.ParamType[Place]):
    """A folder's path, or its URL. file:// is a path."""

    name = "folder or url"

    def __init__(self, *, exists: bool, file: bool = False) -> None:
        self._path = EXISTING if file else EXISTING_FOLDER if exists else FOLDER

    def convert(
        self, value: str | PathLike[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> Place:
        """Convert text to a path; a URL stays text."""
        if isinstance(value, str) and is_url(value):
            if urlsplit(value).scheme != "file":
                return value
            value = unquote(urlsplit(value).path)
        path: Path = self._path.convert(value, param, ctx)
        return path


PLACE: Final = PlaceType(exists=False)
EXISTING_PLACE: Final = PlaceType(exists=True)
#: A folder, its URL, or a file, such as a .blend or .glb.
EXISTING_SCENES: Final = PlaceType(exists=True, file=True)
