"""`legoworld bench serve`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.param_types import EXISTING_FOLDER


@click.command("serve")
@click.argument("dataset", type=EXISTING_FOLDER)
@option(
    "--root",
    "Folder that every submission lies below [default: the working folder].",
    EXISTING_FOLDER,
    default=Path(),
    show_default=False,
)
@option("--no-render", "R alone: no Cycles render, no integrity facts.")
@flag("--diagnostics", "Compute the diagnostics beside R, too.")
@option("--workers")
@options.cache
@options.limits
def serve_command(dataset: Path, **given: Any) -> int:
    """Score submissions as they come: JSON lines on standard input, scores on standard output.

    A request is {"scene": folder, "image_id": number} with an optional "id", which its answer has,
    too; the folder is below --root. An answer has V, R, A, S, the objects' rows and the checks. A
    missing or invalid submission scores zero, with a reason. Every line gets one answer: an invalid
    request gets `refused`, a scoring that failed twice `evaluator_error`, both without numbers.
    Answers come in order of completion. DATASET holds public and private: run this
    where no agent can read it.

    \b
    Examples:
      legoworld bench serve bench < requests.jsonl > scores.jsonl
      legoworld bench serve bench --root submissions --no-render --workers 2 < requests.jsonl
    """
    from legoworld.api.bench import bench_serve
    from legoworld.records.base import canonical

    bench_serve(dataset, sys.stdin.buffer, lambda answer: click.echo(canonical(answer)), **given)
    return 0
