"""`legoworld merge`."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_PLACE, PLACE
from legoworld.pluralize import plural, share
from legoworld.remote import Place

if TYPE_CHECKING:
    from legoworld.commands.output import Document
    from legoworld.records.run_file import RunSummary


@click.command("merge")
@click.argument("shards", nargs=-1, required=True, type=EXISTING_PLACE)
@option("--output", "Run folder to write, or its URL.", PLACE)
@option("--images-per-file")
@option("--overwrite")
@options.printing_json
def command(
    shards: tuple[Place, ...],
    output: Place,
    images_per_file: int | None,
    overwrite: bool,
    out: Output,
) -> int:
    """Join the SHARDS 1/n to n/n of one readout: the same bytes as one undivided run.

    Shards of several tasks are joined task by task. A single undivided run, of a baseline too, is
    rewritten with its predictions in one file, or divided by --images-per-file. Exit code 1 when
    some scene of the run could not be read.

    \b
    Examples:
      legoworld merge shards/* -o run
      legoworld merge shards/* -o run --images-per-file 1000
      legoworld merge s3://bucket/shards/1 s3://bucket/shards/2 -o run
    """
    from legoworld.api.by_task import folder_of_task, tasks_below
    from legoworld.api.family_options import options_by_task
    from legoworld.api.folders import read_from, written_at
    from legoworld.records.folders.read_run import RUN
    from legoworld.running.merge_shards import merge_shards

    with ExitStack() as stack:
        here = [stack.enter_context(read_from(shard)) for shard in shards]
        tasks = tasks_below(here[0], RUN)
        results: dict[Place, RunSummary] = {}
        divided = options_by_task(tasks, images_per_file=images_per_file) if tasks else {}
        names: list[str | None] = [*tasks] or [None]
        for task in names:
            place = output if task is None else folder_of_task(output, task)
            parts = here if task is None else [shard / task for shard in here]
            folder = stack.enter_context(written_at(place, last=RUN))
            per_file = divided[task].get("images_per_file") if task else images_per_file
            results[place] = merge_shards(
                parts, folder, images_per_file=per_file, overwrite=overwrite
            ).summary
    merged: list[Document] = [{"run": str(place), "summary": one} for place, one in results.items()]
    given = plural(len(shards), "run", "shards")
    lines = (
        f"{given}, {share(one.coverage.ok, one.coverage.attempted, 'image', 'images')} read "
        f"-> {place}"
        for place, one in results.items()
    )
    out.show({"runs": merged} if tasks else merged[0], lines)
    whole = all(one.coverage.ok == one.coverage.attempted for one in results.values())
    return 0 if whole else 1
