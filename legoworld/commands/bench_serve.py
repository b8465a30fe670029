"""`legoworld bench serve`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.param_types import EXISTING_FOLDER

if TYPE_CHECKING:
    from legoworld.scene.blender_process import Limits
    from legoworld.scene.cache import SnapshotCache


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
def serve_command(
    dataset: Path,
    root: Path,
    render: bool,
    diagnostics: bool,
    workers: int | None,
    cache: SnapshotCache | None,
    limits: Limits,
) -> int:
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
    from legoworld.bench.server import ScoreServer, ServeOptions
    from legoworld.evaluation.reconstruction.dataset import read_dataset
    from legoworld.evaluation.reconstruction.protocol import bench_protocol
    from legoworld.records.base import canonical
    from legoworld.records.bench_serving import ServeAnswer
    from legoworld.running.submission import bench_rules
    from legoworld.workers.processors import usable_cores

    bench = bench_protocol()
    count = workers or usable_cores()
    serving = ServeOptions(
        root=root.absolute(),
        dataset=read_dataset(dataset / "private"),
        bench=bench,
        rules=bench_rules(bench.card, render=render, noise=False, facts=render),
        diagnostics=diagnostics,
        cache=cache,
        limits=limits,
        threads=max(1, usable_cores() // count),
    )

    def say(answer: ServeAnswer) -> None:
        click.echo(canonical(answer))

    with ScoreServer(serving, count) as server:
        server.serve(sys.stdin.buffer, say)
    return 0
