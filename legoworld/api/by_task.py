"""Several tasks: what each gave, in a folder named by it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Generic, Protocol, TypeVar

from legoworld.errors import UsageError
from legoworld.remote import Place, child
from legoworld.tasks.registry import task_names


class Result(Protocol):
    """A run, an evaluation or a comparison."""

    @property
    def table(self) -> list[dict[str, Any]]:
        """Rows of plain values."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """The document that its command prints with --json."""
        ...

    def _repr_html_(self) -> str: ...


R = TypeVar("R", bound=Result)


@dataclass(frozen=True, kw_only=True)
class ByTask(Mapping[str, R], Generic[R]):
    """The results of several tasks, in the order of the tasks. folder: FOLDER/<task> holds each."""

    folder: Place
    results: Mapping[str, R]

    @property
    def table(self) -> list[dict[str, Any]]:
        """The rows of every task with its name: `pandas.DataFrame(x.table)`."""
        return [{"task": task, **row} for task, one in self.items() for row in one.table]

    def to_dict(self) -> dict[str, Any]:
        """The document that the command prints with --json: each task's own, by task."""
        return {"folder": str(self.folder), "tasks": {k: v.to_dict() for k, v in self.items()}}

    def _repr_html_(self) -> str:
        return "".join(f"<h4>{task}</h4>{one._repr_html_()}" for task, one in self.items())

    def __getitem__(self, task: str) -> R:
        return self.results[task]

    def __iter__(self) -> Iterator[str]:
        return iter(self.results)

    def __len__(self) -> int:
        return len(self.results)


def task_folder(folder: Place, task: str) -> Place:
    """FOLDER/<task>."""
    return child(folder, task) if isinstance(folder, str) else folder / task


def refuse_result_at(folder: Place, holds: str, what: str) -> None:
    """UsageError for a folder that is itself one task's result: it holds the file `holds`."""
    if isinstance(folder, Path) and (folder / holds).is_file():
        raise UsageError(
            f"{folder.name} cannot hold {what}",
            found=f"the result of one task ({holds})",
            expected="an empty folder, or one with a folder for each task",
            next_step="choose another -o",
        )


def tasks_below(folder: Path, holds: str) -> list[str]:
    """The tasks with a folder below a folder that itself has no file `holds`; [] for others."""
    if (folder / holds).is_file() or not folder.is_dir():
        return []
    return [task for task in task_names() if (folder / task / holds).is_file()]


def task_folders(folder: Path, holds: str) -> list[Path]:
    """One task's result, or those of several below a folder."""
    return [folder / task for task in tasks_below(folder, holds)] or [folder]


def task_entry(folder: Path, task: str, what: str) -> Path:
    """FOLDER/<task>.json, or the folder FOLDER/<task>. what: such as "track".

    UsageError where there is neither.
    """
    for path in (folder / f"{task}.json", folder / task):
        if path.exists():
            return path
    held = ", ".join(sorted(p.name for p in folder.iterdir())[:5])
    raise UsageError(
        f"there is no {what} of {task}",
        found=f"{PurePosixPath(folder).name}/ holds {held or 'nothing'}",
        expected=f"{task}.json or {task}/ in it",
    )
