"""`legoworld merge`."""

from __future__ import annotations

from contextlib import ExitStack

import click

from legoworld.commands import options
from legoworld.commands.remote import PlaceType
from legoworld.pluralize import counted, share
from legoworld.remote import Place


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

    A single undivided run, of a baseline too, is rewritten with its predictions in one file, or
    divided by --images-per-file. Exit code 1 when some scene of the run could not be read.

    \b
    Examples:
      legoworld merge shards/* -o run
      legoworld merge shards/* -o run --images-per-file 1000
      legoworld merge s3://bucket/shards/1 s3://bucket/shards/2 -o run
    """
    from legoworld.api.folders import read_from, written_at
    from legoworld.running.merging import merge_shards

    with ExitStack() as stack:
        here = [stack.enter_context(read_from(shard)) for shard in shards]
        folder = stack.enter_context(written_at(output, last="run.json"))
        result = merge_shards(here, folder, images_per_file=images_per_file, overwrite=overwrite)
    coverage = result.summary.coverage
    if as_json:
        options.print_json({"run": str(output), "summary": result.summary})
    else:
        given = counted(len(shards), "run", "shards")
        read = share(coverage.ok, coverage.attempted, "image", "images")
        click.echo(f"{given}, {read} read -> {output}")
    return 0 if coverage.ok == coverage.attempted else 1
