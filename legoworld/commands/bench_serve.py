"""`legoworld bench serve`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from legoworld.commands import options


@click.command("serve", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("dataset", type=options.EXISTING_FOLDER)
@click.option(
    "--root",
    type=options.EXISTING_FOLDER,
    default=Path(),
    help="Folder that every submission lies below [default: the working folder].",
)
@click.option("--no-render", is_flag=True, help="R alone: no Cycles render, no integrity facts.")
@click.option("--diagnostics", is_flag=True, help="Compute the diagnostics beside R, too.")
@click.option("--workers", type=click.IntRange(min=1), help="Blender processes [default: cores].")
@options.caching
@options.limits
def serve_command(
    dataset: Path,
    root: Path,
    no_render: bool,
    diagnostics: bool,
    workers: int | None,
    cache: Path | None,
    no_cache: bool,
    time_limit: float,
    memory_limit: float,
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
    from legoworld.api.settings import limits_of, snapshot_cache
    from legoworld.bench.serving import ScoreServer, ServeOptions
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
        rules=bench_rules(bench.card, render=not no_render, noise=False, facts=not no_render),
        diagnostics=diagnostics,
        cache=snapshot_cache(options.cache_choice(cache, no_cache)),
        limits=limits_of(time_limit, memory_limit),
        threads=max(1, usable_cores() // count),
    )

    def say(answer: ServeAnswer) -> None:
        click.echo(canonical(answer))

    with ScoreServer(serving, count) as server:
        server.serve(sys.stdin.buffer, say)
    return 0
