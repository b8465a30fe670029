"""`legoworld merge`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_PLACE, PLACE
from legoworld.pluralize import plural, share
from legoworld.remote import Place

if TYPE_CHECKING:
    from legoworld.commands.output import Document


@click.command("merge")
@click.argument("shards", nargs=-1, required=True, type=EXISTING_PLACE)
@option("--output", "Run folder to write, or its URL.", PLACE)
@option("--images-per-file")
@option("--overwrite")
@options.printing_json
def command(shards: tuple[Place, ...], output: Place, out: Output, **given: Any) -> int:
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
    from legoworld.api.by_task import ByTask
    from legoworld.api.merging import merge

    merged = merge(shards, output, **given)
    runs = [*merged.values()] if isinstance(merged, ByTask) else [merged]
    documents: list[Document] = [{"run": str(one.folder), "summary": one.summary} for one in runs]
    parts = plural(len(shards), "run", "runs")
    lines = (
        f"{parts}, {share(coverage.ok, coverage.attempted, 'image', 'images')} read -> {one.folder}"
        for one in runs
        for coverage in [one.summary.coverage]
    )
    out.show({"runs": documents} if isinstance(merged, ByTask) else documents[0], lines)
    return 0 if all(one.complete for one in runs) else 1
