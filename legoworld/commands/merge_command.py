"""`legoworld merge`."""

from __future__ import annotations

from pathlib import Path

import click

from legoworld.commands import options


@click.command("merge", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("shards", nargs=-1, required=True, type=options.EXISTING_FOLDER)
@click.option("-o", "--output", required=True, type=options.FOLDER, help="The run to write.")
@click.option("--overwrite", is_flag=True, help="Delete the results of an earlier run first.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(shards: tuple[Path, ...], output: Path, overwrite: bool, as_json: bool) -> int:
    """Put the SHARDS 1/n to n/n of one readout together: the same bytes as one undivided run.

    Exit code 1 when some scene of the run could not be read.

    \b
    Examples:
      legoworld merge shards/* -o run
    """
    from legoworld.running.merging import merge_shards

    result = merge_shards(shards, output, overwrite=overwrite)
    coverage = result.summary["coverage"]
    if as_json:
        options.print_json({"run": str(output), "summary": result.summary})
    else:
        click.echo(
            f"{len(shards)} shards, {coverage['ok']} of {coverage['attempted']} images read "
            f"-> {output}"
        )
    return 0 if coverage["ok"] == coverage["attempted"] else 1
