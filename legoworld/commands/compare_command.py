"""`legoworld compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from legoworld import exit_codes
from legoworld.commands import options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from legoworld.api.by_task import ByTask
    from legoworld.api.comparison import Comparison
    from legoworld.api.evaluation import Evaluation


@click.command("compare", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("evaluations", nargs=-1, required=True, type=options.EXISTING_FOLDER)
@click.option(
    "-o", "--output", type=options.FOLDER, required=True, help="Comparison folder to write."
)
@click.option(
    "--join",
    "joining",
    is_flag=True,
    help="Join comparisons of different tasks (the arguments) into one table.",
)
@click.option(
    "--draws",
    type=click.IntRange(min=1),
    help="Bootstrap samples and tie orders [default: 2000].",
)
@click.option(
    "--seed", type=click.IntRange(min=0), help="RNG seed for tie orders and bootstrap [default: 0]."
)
@click.option(
    "--fail-below",
    "thresholds",
    multiple=True,
    metavar="METRIC=DELTA",
    help="Exit 3 when the scene's gain over a baseline is below DELTA; repeatable.",
)
@click.option(
    "--allow-truth-prompts",
    is_flag=True,
    help="Accept a baseline that was prompted with ground truth; every table says so.",
)
@click.option("--overwrite", is_flag=True, help="Replace an existing comparison in the folder.")
@options.output_options
def command(
    evaluations: tuple[Path, ...],
    output: Path,
    joining: bool,
    draws: int | None,
    seed: int | None,
    thresholds: tuple[str, ...],
    allow_truth_prompts: bool,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Compare the first of EVALUATIONS, the scene's, with each of the others.

    EVALUATIONS of one task, or folders of the evaluations of several: each task is then compared
    into its own folder of the output.

    Prints the headline metrics and which side each favours; -v prints everything.
    Numbers are over all attempted images and over paired ones (scored on both sides, with ground
    truth). Differences have intervals from bootstrap samples that both sides share. Evaluations
    with different ground truth, tracks, cards, evaluators or versions are refused.

    A gain is an improvement: scene minus baseline for scores, baseline minus scene for errors.
    --fail-below uses all attempted images where the metric has them; paired.METRIC uses the paired
    ones.

    \b
    Examples:
      legoworld compare evals/scene evals/dino -o comparisons/coco
      legoworld compare evals/scene evals/dino -o comparisons/coco --fail-below AP=-0.3
      legoworld compare evals-scene evals-specialists -o comparisons
      legoworld compare --join comparisons/coco comparisons/eth3d -o comparisons/all
    """
    from legoworld.api.comparison import Comparison, compare
    from legoworld.api.listening import Listener
    from legoworld.comparison.tables import comparisons_of
    from legoworld.evaluation.family import evaluation_of

    if joining:
        if draws is not None or seed is not None or thresholds or allow_truth_prompts:
            raise click.UsageError(
                "--join takes finished comparisons: only -o can be combined with it"
            )
        from legoworld.comparison.making import make_joined

        joined = make_joined(evaluations, output, overwrite=overwrite)
        comparison = Comparison(folder=output, document=joined, below=())
        if as_json:
            options.print_json(comparison.to_dict())
        else:
            _print(comparison, verbose=verbose)
        return exit_codes.DONE
    found = compare(
        cast("Sequence[Path]", [_evaluated(folder) for folder in evaluations]),
        output,
        draws=2000 if draws is None else draws,
        seed=seed or 0,
        fail_below=thresholds,
        allow_truth_prompts=allow_truth_prompts,
        overwrite=overwrite,
        listener=Listener(notice=options.notifier(quiet or not (verbose or options.on_terminal()))),
    )
    comparisons = [found] if isinstance(found, Comparison) else list(found.values())
    if as_json:
        options.print_json(found.to_dict())
    else:
        for comparison in comparisons:
            _print(comparison, verbose=verbose)
        tasks = {one.task for c in comparisons for one in comparisons_of(c.document)}
        photos = any(evaluation_of(task).photos for task in tasks)
        click.echo(options.report_hint(output, photos=photos))
    below = [one for comparison in comparisons for one in comparison.below]
    for one in below:
        click.echo(f"legoworld: below its threshold: {one}", err=True)
    return exit_codes.BELOW if below else exit_codes.DONE


def _evaluated(folder: Path) -> Path | ByTask[Evaluation]:
    """An evaluation's folder, or the evaluations of several tasks below it."""
    from legoworld.api.by_task import ByTask, tasks_below
    from legoworld.api.evaluation import Evaluation
    from legoworld.records.folders.evaluation_reading import EVIDENCE

    tasks = tasks_below(folder, EVIDENCE)
    opened = {task: Evaluation.open(folder / task) for task in tasks}
    return ByTask(folder=folder, results=opened) if tasks else folder


def _print(found: Comparison, *, verbose: bool) -> None:
    from legoworld.commands.comparison_text import short_comparison, whole_comparison

    shown = whole_comparison if verbose else short_comparison
    click.echo(f"{shown(found.document)}\n\n-> {found.folder}")
