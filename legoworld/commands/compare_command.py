"""`legoworld compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.comparison_text import coverage_text, headline_text, notes_text

if TYPE_CHECKING:
    from legoworld.api.comparison import Comparison
    from legoworld.comparison.tables import Document


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
      legoworld compare evals/scene evals/dino evals/yolox -o comparisons/coco
      legoworld compare evals/scene evals/dino -o comparisons/coco --fail-below AP=-0.3
      legoworld compare --join comparisons/coco comparisons/eth3d -o comparisons/all
    """
    from legoworld.api.comparison import Comparison, compare
    from legoworld.api.listening import Listener

    if joining:
        if draws is not None or seed is not None or thresholds or allow_truth_prompts:
            raise click.UsageError(
                "--join takes finished comparisons: only -o can be combined with it"
            )
        from legoworld.comparison.making import make_joined

        joined = make_joined(evaluations, output, overwrite=overwrite)
        _show(Comparison(folder=output, document=joined, below=()), as_json, verbose, joined=True)
        return exit_codes.DONE
    comparison = compare(
        evaluations,
        output,
        draws=2000 if draws is None else draws,
        seed=seed or 0,
        fail_below=thresholds,
        allow_truth_prompts=allow_truth_prompts,
        overwrite=overwrite,
        listener=Listener(notice=options.notifier(quiet or not (verbose or options.on_terminal()))),
    )
    _show(comparison, as_json, verbose)
    for one in comparison.below:
        click.echo(f"legoworld: below its threshold: {one}", err=True)
    return exit_codes.BELOW if comparison.below else exit_codes.DONE


def _show(found: Comparison, as_json: bool, verbose: bool, *, joined: bool = False) -> None:
    from legoworld.commands.comparison_short import short_comparison
    from legoworld.comparison.tables import comparisons_of
    from legoworld.evaluation.family import evaluation_of

    if as_json:
        options.print_json(found.to_dict())
        return
    click.echo(_tables(found.document) if verbose else short_comparison(found.document))
    click.echo(f"\n-> {found.folder}")
    if not joined:
        (one,) = comparisons_of(found.document)
        click.echo(options.report_hint(found.folder, photos=evaluation_of(one.task).photos))


def _tables(document: Document) -> str:
    from legoworld.comparison.tables import coverage_table, headline_table

    headline = headline_table(document)
    parts = (headline_text(headline), coverage_text(coverage_table(document)))
    return "\n\n".join((*parts, notes_text(headline.notes)))
