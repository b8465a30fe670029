"""`legoworld compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Unpack, cast

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output, report_hint
from legoworld.commands.param_types import EXISTING_FOLDER

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from legoworld.api.by_task import ByTask
    from legoworld.api.comparison import Comparison, ComparisonOptions
    from legoworld.api.evaluation import Evaluation


@click.command("compare")
@click.argument("evaluations", nargs=-1, required=True, type=EXISTING_FOLDER)
@option("--output", "Comparison folder to write.")
@flag("--join joining", "Join comparisons of different tasks (the arguments) into one table.")
@option("--draws", "Bootstrap samples and tie orders.", default=2000)
@option("--seed")
@option(
    "--fail-below",
    "Exit 3 when the scene's gain over a baseline is below DELTA; repeatable.",
    multiple=True,
    metavar="METRIC=DELTA",
)
@flag(
    "--allow-truth-prompts",
    "Accept a baseline that was prompted with ground truth; every table says so.",
)
@option("--overwrite", "Replace an existing comparison in the folder.")
@options.printing
def command(
    evaluations: tuple[Path, ...],
    output: Path,
    joining: bool,
    out: Output,
    **given: Unpack[ComparisonOptions],
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
    from legoworld.api.listener import Listener

    if joining:
        return _join(evaluations, output, out, overwrite=given.get("overwrite", False))
    given["listener"] = Listener(notice=out.step)
    found = compare(
        cast("Sequence[Path]", [_require_evaluation(folder) for folder in evaluations]),
        output,
        **given,
    )
    comparisons = [found] if isinstance(found, Comparison) else list(found.values())
    out.show(found.to_dict, _lines(comparisons, output, verbose=out.verbose))
    below = [one for comparison in comparisons for one in comparison.below]
    for one in below:
        click.echo(f"legoworld: below its threshold: {one}", err=True)
    return exit_codes.BELOW if below else exit_codes.DONE


def _join(evaluations: Sequence[Path], output: Path, out: Output, *, overwrite: bool) -> int:
    """Join finished comparisons; how a comparison is made is refused."""
    from legoworld.api.comparison import Comparison
    from legoworld.comparison.make_comparison import join_folders

    options.refuse_given(
        ("draws", "seed", "fail_below", "allow_truth_prompts"),
        "cannot be combined with --join, which takes finished comparisons",
    )
    joined = join_folders(evaluations, output, overwrite=overwrite)
    comparison = Comparison(folder=output, document=joined, below=())
    out.show(comparison.to_dict, [_text(comparison, verbose=out.verbose)])
    return exit_codes.DONE


def _require_evaluation(folder: Path) -> Path | ByTask[Evaluation]:
    """An evaluation's folder, or the evaluations of several tasks below it."""
    from legoworld.api.by_task import ByTask, tasks_below
    from legoworld.api.evaluation import Evaluation
    from legoworld.records.folders.read_evaluation import EVIDENCE

    tasks = tasks_below(folder, EVIDENCE)
    opened = {task: Evaluation.open(folder / task) for task in tasks}
    return ByTask(folder=folder, results=opened) if tasks else folder


def _lines(comparisons: list[Comparison], output: Path, *, verbose: bool) -> Iterator[str]:
    from legoworld.comparison.tables import list_comparisons
    from legoworld.evaluation.family import load_evaluation_family

    yield from (_text(comparison, verbose=verbose) for comparison in comparisons)
    tasks = {one.task for c in comparisons for one in list_comparisons(c.document)}
    yield report_hint(output, photos=any(load_evaluation_family(task).photos for task in tasks))


def _text(comparison: Comparison, *, verbose: bool) -> str:
    from legoworld.commands.comparison_text import short_comparison, whole_comparison

    shown = whole_comparison if verbose else short_comparison
    return f"{shown(comparison.document)}\n\n-> {comparison.folder}"
