"""`merge`: the shards of a readout as one run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from legoworld.api.arguments import check_arguments
from legoworld.api.by_task import ByTask, task_folder, tasks_below
from legoworld.api.folders import parse_place, read_from, written_at
from legoworld.api.readout import Run
from legoworld.records.folders.read_run import RUN
from legoworld.remote import Place
from legoworld.running.merge_shards import merge_shards
from legoworld.tasks.registry import options_by_task


@check_arguments
def merge(
    shards: Sequence[str | Path],
    output: str | Path,
    *,
    images_per_file: int | None = None,
    overwrite: bool = False,
) -> Run | ByTask[Run]:
    """Join the shards 1/n to n/n of one readout: the same bytes as one undivided run.

    shards, output: folders or their URLs. Shards of several tasks are joined task by task, and
    output/<task> is each run. images_per_file, overwrite: as in `readout`.
    """
    top = parse_place(output)
    with ExitStack() as stack:
        here = [stack.enter_context(read_from(parse_place(shard))) for shard in shards]

        def join(parts: Sequence[Path], place: Place, per_file: int | None) -> Run:
            folder = stack.enter_context(written_at(place, last=RUN))
            made = merge_shards(parts, folder, images_per_file=per_file, overwrite=overwrite)
            return Run(folder=place, rows=made.rows, summary=made.summary, strangers=())

        tasks = tasks_below(here[0], RUN)
        if not tasks:
            return join(here, top, images_per_file)
        own = options_by_task(tasks, images_per_file=images_per_file)
        runs = {
            task: join(
                [shard / task for shard in here],
                task_folder(top, task),
                own[task].get("images_per_file"),
            )
            for task in tasks
        }
        return ByTask(folder=top, results=runs)
