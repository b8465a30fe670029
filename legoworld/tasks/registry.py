"""The one table of tasks: those that ship, and those of installed packages.

A package adds a task by an entry point of the group `legoworld.tasks`: its name is the task's, and
its value a `Task`. It is imported when that task is asked for, or all tasks are listed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from legoworld.errors import InstallationError, UsageError, cause
from legoworld.pluralize import did_you_mean
from legoworld.tasks.shipped import TASKS
from legoworld.tasks.task import Family, Task

GROUP: Final = "legoworld.tasks"
_SHIPPED: Final = {task.name: task for task in TASKS}
#: Parameters whose option has another name.
_OPTIONS: Final = {"diagnostics": "--no-diagnostics", "render": "--no-render"}


def find_task(name: str) -> Task | None:
    """The task of a name, None for no task. InstallationError for one that cannot be loaded."""
    if name in _SHIPPED:
        return _SHIPPED[name]
    entries = _added_entry_points().get(name, [])
    if len(entries) > 1:
        packages = ", ".join(sorted(_package(entry) for entry in entries))
        raise InstallationError(
            f"more than one package adds the task {name}",
            found=packages,
            expected="one",
            next_step="uninstall the others",
        )
    return _load_task(entries[0]) if entries else None


def require_task(name: str) -> Task:
    """The task of a name. UsageError for no task; the same error."""
    task = find_task(name)
    if task is None:
        names = list(task_names())
        raise UsageError(
            f"unknown task {name!r}",
            expected=" or ".join(names),
            next_step=did_you_mean(name, names).strip(),
        )
    return task


def find_family(task: str) -> Family:
    """The family of a task by its name. The same errors."""
    return require_task(task).family


def task_names() -> tuple[str, ...]:
    """The names of all tasks, those that ship first; others by name."""
    return (*_SHIPPED, *sorted(_added_entry_points().keys() - _SHIPPED.keys()))


def known_tasks() -> tuple[Task, ...]:
    """Every task that can be loaded, those that ship first; others by name."""
    return (*TASKS, *_load_added()[0])


def broken_tasks() -> list[InstallationError]:
    """Why tasks of installed packages cannot be asked for; `known_tasks` leaves them out."""
    return _load_added()[1]


def family_tasks(family: Family) -> tuple[Task, ...]:
    """The tasks of one family."""
    return tuple(task for task in known_tasks() if task.family == family)


def options_by_task(tasks: Sequence[str], **given: Any) -> dict[str, dict[str, Any]]:
    """The given parameters of each task's family, without those that are None.

    UsageError for one that none of these families takes.
    """
    named = {name: value for name, value in given.items() if value is not None}
    taken = {
        task: {name: named[name] for name in named if name in find_family(task).options}
        for task in tasks
    }
    for name in named:
        if not any(name in own for own in taken.values()):
            takers = [other for other in known_tasks() if name in other.family.options]
            what = " and ".join(dict.fromkeys(other.family.noun for other in takers))
            raise UsageError(
                f"{_OPTIONS.get(name, '--' + name.replace('_', '-'))} is for {what} alone",
                found=f"a run of {' and '.join(tasks)}",
                expected=f"the task {' or '.join(other.name for other in takers)}",
            )
    return taken


def _load_added() -> tuple[list[Task], list[InstallationError]]:
    """The tasks of installed packages by name, and the errors of those that cannot be loaded."""
    tasks: list[Task] = []
    errors: list[InstallationError] = []
    for name in task_names()[len(TASKS) :]:
        try:
            tasks.append(require_task(name))
        except InstallationError as error:
            errors.append(error)
    return tasks, errors


@cache
def _added_entry_points() -> dict[str, list[EntryPoint]]:
    """The entry points of installed packages, by task."""
    entries: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=GROUP):
        entries.setdefault(entry.name, []).append(entry)
    return entries


@cache
def _load_task(entry: EntryPoint) -> Task:
    expected = f"a legoworld.tasks.task.Task named {entry.name!r}"
    try:
        value = entry.load()
    except Exception as error:  # a package of others may raise anything
        raise InstallationError(
            f"the task {entry.name} of {_package(entry)} cannot be loaded",
            found=cause(error),
            expected=expected,
            next_step=f"mend or uninstall {_package(entry)}",
        ) from error
    if not isinstance(value, Task) or value.name != entry.name:
        raise InstallationError(
            f"the task {entry.name} of {_package(entry)} cannot be used",
            found=f"{entry.value} is {getattr(value, 'name', type(value).__name__)!r}",
            expected=expected,
        )
    return value


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else entry.module
