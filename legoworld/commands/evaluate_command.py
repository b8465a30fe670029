"""`legoworld evaluate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld.commands import options

if TYPE_CHECKING:
    from legoworld.evaluation.evaluators import EvaluatorKind


@click.command("evaluate", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("run", type=options.EXISTING_FOLDER)
@click.option(
    "--truth",
    required=True,
    type=click.Path(path_type=Path, exists=True),
    help="The dataset's own annotations: COCO or LVIS JSON, or ETH3D's folder.",
)
@click.option("-o", "--output", type=options.FOLDER, required=True, help="The folder to write.")
@click.option(
    "--evaluator",
    type=click.Choice(["official", "fast"]),
    help="pycocotools and lvis, or hotcoco [default: official, where it is installed].",
)
@click.option(
    "--camera-model",
    type=click.Choice(["none", "dataset"]),
    help="Depth only: warp a scene's pinhole depth through the dataset's camera [default: none].",
)
@click.option(
    "--draws",
    type=click.IntRange(min=1),
    default=2000,
    show_default=True,
    help="Tie orders and bootstrap samples.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of both.")
@click.option("--overwrite", is_flag=True, help="Replace another evaluation in the folder.")
@options.output_options
def command(
    run: Path,
    truth: Path,
    output: Path,
    evaluator: EvaluatorKind | None,
    camera_model: str | None,
    draws: int,
    seed: int,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Score a RUN against private truth.

    Boxes and masks go through the official evaluator, unchanged, over every image the run
    attempted; its lines come first, then intervals, tie orders and score-free overlaps with what
    each is counted over. The folder holds truth: keep it private.

    \b
    Examples:
      legoworld evaluate runs/coco --truth instances_val2017.json -o evals/coco
      legoworld evaluate runs/lvis --truth lvis_v1_val.json -o evals/lvis --evaluator fast
      legoworld evaluate runs/depth --truth eth3d -o evals/depth
    """
    from legoworld.evaluation.run import read_run

    task = read_run(run).task
    notice = options.notifier(quiet or not verbose)
    if task == "eth3d":
        if evaluator is not None:
            raise click.UsageError("--evaluator is for boxes and masks: depth has one evaluator")
        return _depth(
            run,
            truth,
            output,
            camera_model=camera_model or "none",
            draws=draws,
            seed=seed,
            overwrite=overwrite,
            as_json=as_json,
        )
    if camera_model is not None:
        raise click.UsageError("--camera-model is for depth: boxes and masks are not warped")
    from legoworld.evaluation.detections import evaluate_detections
    from legoworld.evaluation.protocols import detection_protocol
    from legoworld.evaluation.text import evaluation_text

    evaluation = evaluate_detections(
        run,
        truth,
        output,
        evaluator=evaluator,
        draws=draws,
        seed=seed,
        overwrite=overwrite,
        notice=notice,
        warn=options.notifier(quiet),
    )
    if as_json:
        options.print_json({"evaluation": str(output), "summary": evaluation.summary})
    else:
        protocol = detection_protocol(task)
        click.echo(evaluation_text(evaluation.summary, protocol, options.table))
        click.echo(f"-> {output}")
    return 0
