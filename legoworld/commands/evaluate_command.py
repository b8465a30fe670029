"""`legoworld evaluate`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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

    found = read_run(run)
    task = found.task
    notice = options.notifier(quiet or not (verbose or options.on_terminal()))
    if task == "eth3d":
        if evaluator is not None:
            raise click.UsageError("--evaluator is for boxes and masks: depth has one evaluator")
        from legoworld.evaluation.depth.evaluate import evaluate_depth

        with _bar(len(found.images), shown=not quiet and options.on_terminal()) as step:
            summary = evaluate_depth(
                run,
                truth,
                output,
                camera_model=camera_model or "none",
                draws=draws,
                seed=seed,
                overwrite=overwrite,
                progress=step,
            )
        _show(summary, _depth_text, output, as_json=as_json)
        return 0
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
    protocol = detection_protocol(task)
    _show(
        evaluation.summary,
        lambda summary: evaluation_text(summary, protocol, options.table),
        output,
        as_json=as_json,
    )
    return 0


@contextmanager
def _bar(n_images: int, *, shown: bool) -> Iterator[Callable[[dict[str, Any]], None] | None]:
    """Told of each image's row, a bar on standard error with the images that got no score."""
    if not shown:
        yield None
        return
    failed = 0
    with click.progressbar(length=n_images, label="scoring", file=sys.stderr, show_pos=True) as bar:

        def step(row: dict[str, Any]) -> None:
            nonlocal failed
            failed += "metrics" not in row
            bar.label = f"scoring, {failed} without a score" if failed else "scoring"
            bar.update(1)

        yield step


def _show(
    summary: dict[str, Any],
    text: Callable[[dict[str, Any]], str],
    output: Path,
    *,
    as_json: bool,
) -> None:
    if as_json:
        options.print_json({"evaluation": str(output), "summary": summary})
    else:
        click.echo(f"{text(summary)}\n\n-> {output}")


def _depth_text(summary: dict[str, Any]) -> str:
    """Means by hole policy with the constant beside them, intervals and denominators."""
    coverage, groups = summary["coverage"], summary["bootstrap"]
    rows = []
    for metric, by_policy in summary["metrics"].items():
        for policy, value in by_policy.items():
            found = summary["intervals"][metric][policy]
            known = found["low"] is not None
            spread = f"{found['low']:.4f} .. {found['high']:.4f}" if known else "-"
            constant = summary["constant"][metric][policy]
            shown = ["-" if x is None else f"{x:.4f}" for x in (value, constant)]
            rows.append((metric, policy, shown[0], spread, shown[1]))
    evaluator, protocol = summary["evaluator"], summary["protocol"]
    header = ("metric", "holes", "mean", "95 % interval", "constant")
    every = summary["all_attempted"]
    lines = [
        f"{evaluator['name']} {evaluator['version']}, camera model {protocol['camera_model']}, "
        f"{coverage['attempted']} images attempted, {coverage['scored']} scored, "
        f"{coverage['with_truth']} with truth; intervals over {groups['groups']} "
        f"{groups['unit']}s",
        options.table(header, rows),
        f"over all {every['images']} images with truth, {every['missing']} of them without a score "
        f"at {every['missing_abs_rel']:g}: abs_rel "
        + ", ".join(
            f"{policy} {'-' if value is None else format(value, '.4f')}"
            for policy, value in every["abs_rel"].items()
        ),
        *_depth_counts(summary),
        *(f"{r['status']}: {r['file_name']}: {r['reason']}" for r in summary["not_scored"]),
    ]
    return "\n\n".join(lines[:3]) + "".join(f"\n{line}" for line in lines[3:])


def _depth_counts(summary: dict[str, Any]) -> list[str]:
    """What the means do not show: flagged fits, images without truth, holes and clamped pixels."""
    by_status = summary["coverage"]["by_status"]
    flagged = [f"{by_status.get(name, 0)} {name}" for name in ("inverted", "degenerate", "no_gt")]
    others = [f"{n} {name}" for name, n in by_status.items() if f"{n} {name}" not in flagged]
    shares = {
        "holes": summary["mean_hole_share"],
        "outside the view": summary["mean_outside_view_share"],
        "clamped": summary["mean_clamped_share"],
    }
    return [
        f"images: {', '.join([*others, *flagged])}; "
        f"{summary['worse_than_constant']} worse than a constant, "
        f"{summary['resampled']} resampled, {summary['warnings']} warnings",
        "mean share of truth pixels: "
        + ", ".join(
            f"{name} {'-' if x is None else format(x, '.4f')}" for name, x in shares.items()
        ),
    ]
