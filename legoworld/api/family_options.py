"""Parameters that only some families take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from legoworld.errors import UsageError
from legoworld.tasks.registry import find_family, known_tasks

#: Parameters whose option has another name.
_OPTIONS: Final = {"diagnostics": "--no-diagnostics", "render": "--no-render"}


def own_options(task: str, **given: Any) -> dict[str, Any]:
    """The given parameters of a task's family, without those that are None.

    UsageError for one that only other families take.
    """
    return options_by_task([task], **given)[task]


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
