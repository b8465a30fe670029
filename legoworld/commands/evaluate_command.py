"""`legoworld evaluate`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from legoworld import exit_codes
from legoworld.api.listening import Listener
from legoworld.commands import options
from legoworld.commands.remote import PlaceType
from legoworld.remote import Place

if TYPE_CHECKING:
    from click._termui_impl import ProgressBar

    from legoworld.api.evaluation import Evaluation
    from legoworld.evaluation.detection.evaluators import EvaluatorKind
    from legoworld.records.evaluation_rows import EvaluationRow


@click.command("evaluate", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("run", type=PlaceType(exists=True))
@click.option(
    "--truth",
    "truths",
    required=True,
    multiple=True,
    metavar="PATH",
    help="Ground truth: COCO or LVIS JSON, ETH3D's folder, or a bench's DATASET/private. For a "
    "folder of runs: TASK=PATH, repeatable, or a folder with <task>.json or <task>/ of each.",
)
@click.option(
    "-o",
    "--output",
    type=PlaceType(exists=False),
    required=True,
    help="Evaluation folder to write, or its URL; of a folder of runs the folder of theirs.",
)
@click.option(
    "--evaluator",
    type=options.Choice(["official", "fast"]),
    help="pycocotools and lvis, or hotcoco [default: official, where it is installed].",
)
@click.option(
    "--camera-model",
    type=options.Choice(["none", "dataset"]),
    help="Depth only: warp a scene's pinhole depth through the dataset's camera [default: none].",
)
@click.option(
    "--reference-sampling",
    metavar="SAMPLING",
    help="Bench only: raster, all full-size pixels, or random:SEED of them [default: raster].",
)
@click.option(
    "--no-diagnostics", is_flag=True, help="Bench only: V, R, A, S without the numbers beside R."
)
@click.option(
    "--draws",
    type=click.IntRange(min=1),
    help="Number of tie orders and of bootstrap samples [default: 2000, bench 10000].",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="RNG seed for tie orders and bootstrap.",
)
@click.option("--workers", type=click.IntRange(min=1), help="Worker processes [default: cores].")
@options.engine
@click.option("--overwrite", is_flag=True, help="Replace an existing evaluation in the folder.")
@options.output_options
def command(
    run: Place,
    truths: tuple[str, ...],
    output: Place,
    evaluator: EvaluatorKind | None,
    camera_model: Literal["none", "dataset"] | None,
    reference_sampling: str | None,
    no_diagnostics: bool,
    draws: int | None,
    seed: int,
    workers: int | None,
    engine: Literal["local", "ray"],
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Score a RUN, or each run of a folder RUN/<task>, against private ground truth.

    Boxes and masks are scored by the unmodified official evaluator over every image the run
    attempted. -v prints the evaluator's own lines, then every metric with its interval and
    denominator. The folder contains ground truth: keep it private. --engine and --workers
    distribute the work and do not change any output byte.

    \b
    Examples:
      legoworld evaluate runs/coco --truth instances_val2017.json -o evals/coco
      legoworld evaluate runs/mine --truth bench/private -o evals/mine
      legoworld evaluate runs --truth coco=instances_val2017.json --truth lvis=lvis.json -o evals
      legoworld evaluate s3://bucket/run --truth lvis_v1_val.json -o s3://private/eval
    """
    from legoworld.api.evaluation import Evaluation, evaluate
    from legoworld.commands.truths import truth_of
    from legoworld.evaluation.family import evaluation_of

    with _listening(quiet=quiet, verbose=verbose) as listener:
        found = evaluate(
            run,
            output,
            truth=truth_of(run, truths),
            evaluator=evaluator,
            camera_model=camera_model,
            reference_sampling=reference_sampling,
            diagnostics=not no_diagnostics,
            draws=draws,
            seed=seed,
            workers=workers,
            engine=engine,
            overwrite=overwrite,
            listener=listener,
        )
    if as_json:
        options.print_json(found.to_dict())
        return exit_codes.DONE
    evaluations = [found] if isinstance(found, Evaluation) else list(found.values())
    for one in evaluations:
        if len(evaluations) > 1:
            click.echo(f"{one.task}:")
        _print(one, verbose=verbose)
    if isinstance(found.folder, Path):
        photos = any(evaluation_of(one.task).photos for one in evaluations)
        click.echo(options.report_hint(found.folder, photos=photos))
    return exit_codes.DONE


def _print(found: Evaluation, *, verbose: bool) -> None:
    from legoworld.evaluation.family import evaluation_of, evaluation_text

    if verbose:
        click.echo(f"{evaluation_text(found.summary)}\n\n-> {found.folder}")
    else:
        click.echo(f"{evaluation_of(found.task).short(found.summary)}\n-> {found.folder}")


@contextmanager
def _listening(*, quiet: bool, verbose: bool) -> Iterator[Listener]:
    """Notices on a terminal or with -v; a progress bar there if images are scored one by one."""
    on_terminal = options.on_terminal()
    notice, warn = options.notifier(quiet or not (verbose or on_terminal)), options.notifier(quiet)
    if quiet or not on_terminal:
        yield Listener(notice=notice, warn=warn)
        return
    images = failed = 0
    with ExitStack() as stack:
        bar: ProgressBar[int] | None = None

        def total(n: int) -> None:
            nonlocal images
            images = n

        def scored(row: EvaluationRow) -> None:
            nonlocal bar, failed
            if bar is None:  # not every family scores image by image
                bar = stack.enter_context(
                    click.progressbar(
                        length=images, label="scoring", file=sys.stderr, show_pos=True
                    )
                )
            failed += row.outcome.sort == "failed"
            bar.label = f"scoring, {failed} without a score" if failed else "scoring"
            bar.update(1)

        yield Listener(total=total, scored=scored, notice=notice, warn=warn)
