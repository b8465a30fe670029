"""`legoworld merge`."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import click

from legoworld.commands import options
from legoworld.commands.remote import PlaceType
from legoworld.pluralize import counted, share
from legoworld.records.base import Storable
from legoworld.remote import Place

if TYPE_CHECKING:
    from legoworld.records.run_file import RunSummary


@click.command("merge", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("shards", nargs=-1, required=True, type=PlaceType(exists=True))
@click.option(
    "-o",
    "--output",
    required=True,
    type=PlaceType(exists=False),
    help="Run folder to write, or its URL.",
)
@click.option(
    "--images-per-file",
    type=click.IntRange(min=1),
    metavar="N",
    help="Boxes and masks: write predictions/00000.jsonl, ... of N images each [default: one "
    "file].",
)
@click.option("--overwrite", is_flag=True, help="Delete the results of an earlier run first.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(
    shards: tuple[Place, ...],
    output: Place,
    images_per_file: int | None,
    overwrite: bool,
    as_json: bool,
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
    from legoworld.records.folders.run_reading import RUN
    from legoworld.running.merging import merge_shards

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
    if as_json:
        merged: list[dict[str, Storable]] = [
            {"run": str(place), "summary": one} for place, one in results.items()
        ]
        options.print_json({"runs": merged} if tasks else merged[0])
    else:
        given = counted(len(shards), "run", "shards")
        for place, one in results.items():
            read = share(one.coverage.ok, one.coverage.attempted, "image", "images")
            click.echo(f"{given}, {read} read -> {place}")
    whole = all(one.coverage.ok == one.coverage.attempted for one in results.values())
    return 0 if whole else 1
