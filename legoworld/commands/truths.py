"""`--truth`: one ground truth, or one for each task of a folder of runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from legoworld.api.by_task import entry_of_task, tasks_below
from legoworld.records.folders.read_run import RUN
from legoworld.remote import Place
from legoworld.tasks.registry import task_names


def parse_truths(run: Place, texts: Sequence[str]) -> Path | dict[str, Path]:
    """What `evaluate` takes as its truth. click.UsageError for texts that cannot be used.

    Of a folder of runs, every run needs a truth where --truth is a folder; TASK=PATH selects runs.
    """
    named = dict(text.split("=", 1) for text in texts if text.partition("=")[0] in task_names())
    if len(named) == len(texts):
        return {task: _require_existing(path) for task, path in named.items()}
    if named or len(texts) > 1:
        raise click.UsageError("--truth is one path, or TASK=PATH once for each task")
    path = _require_existing(texts[0])
    tasks = tasks_below(run, RUN) if isinstance(run, Path) else []
    if not tasks:
        return path
    if not path.is_dir():
        raise click.UsageError(
            f"{run} holds the runs of {', '.join(tasks)}: pass --truth TASK=PATH for each, or a "
            "folder with <task>.json or <task>/ of each"
        )
    return {task: entry_of_task(path, task, "ground truth") for task in tasks}


def _require_existing(path: str) -> Path:
    if not Path(path).exists():
        raise click.BadParameter(f"Path {path!r} does not exist.", param_hint="'--truth'")
    return Path(path)
