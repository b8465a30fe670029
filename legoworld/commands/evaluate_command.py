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
from legoworld.commands.evaluation_bench import bench_text, short_bench
from legoworld.commands.evaluation_short import of_eth3d, short_depth, short_detections
from legoworld.commands.remote import PlaceType
from legoworld.pluralize import counted, range_text
from legoworld.remote import Place

if TYPE_CHECKING:
    from click._termui_impl import ProgressBar

    from legoworld.evaluation.detection.evaluators import EvaluatorKind
    from legoworld.records.evaluation_kinds import TaskSummary
    from legoworld.records.evaluation_rows import DepthRow
    from legoworld.records.evaluation_summary import DepthSummary
    from legoworld.records.reconstruction_rows import ReconstructionRow


@click.command("evaluate", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("run", type=PlaceType(exists=True))
@click.option(
    "--truth",
    required=True,
    type=click.Path(path_type=Path, exists=True),
    help="Ground truth: COCO or LVIS JSON, ETH3D's folder, or a bench's DATASET/private.",
)
@click.option(
    "-o",
    "--output",
    type=PlaceType(exists=False),
    required=True,
    help="Evaluation folder to write, or its URL.",
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
    truth: Path,
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
    """Score a RUN against private ground truth.

    Boxes and masks are scored by the unmodified official evaluator over every image the run
    attempted. -v prints the evaluator's own lines, then every metric with its interval and
    denominator. The folder contains ground truth: keep it private. --engine and --workers
    distribute the work and do not change any output byte.

    \b
    Examples:
      legoworld evaluate runs/coco --truth instances_val2017.json -o evals/coco
      legoworld evaluate runs/lvis --truth lvis_v1_val.json -o evals/lvis --evaluator fast
      legoworld evaluate runs/mine --truth bench/private -o evals/mine
      legoworld evaluate s3://bucket/run --truth lvis_v1_val.json -o s3://private/eval
    """
    from legoworld.api.evaluation import evaluate

    with _listening(quiet=quiet, verbose=verbose) as listener:
        found = evaluate(
            run,
            output,
            truth=truth,
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
    from legoworld.records.reconstruction_summary import ReconstructionSummary

    if as_json:
        options.print_json(found.to_dict())
    elif verbose:
        click.echo(f"{options.within_width(_text(found.summary))}\n\n-> {found.folder}")
    else:
        click.echo(f"{_short(found.summary)}\n-> {found.folder}")
    if not as_json and isinstance(found.folder, Path):
        bench = isinstance(found.summary, ReconstructionSummary)
        click.echo(options.report_hint(found.folder, photos=not bench))
    return exit_codes.DONE


def _short(summary: TaskSummary) -> str:
    from legoworld.records.evaluation_summary import DepthSummary
    from legoworld.records.reconstruction_summary import ReconstructionSummary

    if isinstance(summary, ReconstructionSummary):
        return short_bench(summary)
    if isinstance(summary, DepthSummary):
        return short_depth(summary)
    return short_detections(summary)


def _text(summary: TaskSummary) -> str:
    """Every metric with its interval and what it is over."""
    from legoworld.evaluation.detection.protocols import detection_protocol
    from legoworld.evaluation.detection.text import evaluation_text
    from legoworld.records.evaluation_summary import DepthSummary
    from legoworld.records.reconstruction_summary import ReconstructionSummary

    if isinstance(summary, ReconstructionSummary):
        return bench_text(summary)
    if isinstance(summary, DepthSummary):
        return _depth_text(summary)
    return evaluation_text(summary, detection_protocol(summary.task), options.table)


@contextmanager
def _listening(*, quiet: bool, verbose: bool) -> Iterator[Listener]:
    """Notices on a terminal or with -v; a progress bar there if images are scored one by one."""
    from legoworld.records.evaluation_rows import ScoredDepthRow
    from legoworld.records.reconstruction_rows import COMPARED

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

        def scored(row: DepthRow | ReconstructionRow) -> None:
            nonlocal bar, failed
            if bar is None:  # only depth and bench score image by image
                bar = stack.enter_context(
                    click.progressbar(
                        length=images, label="scoring", file=sys.stderr, show_pos=True
                    )
                )
            failed += not (isinstance(row, ScoredDepthRow) or row.status == COMPARED)
            bar.label = f"scoring, {failed} without a score" if failed else "scoring"
            bar.update(1)

        yield Listener(total=total, scored=scored, notice=notice, warn=warn)


def _depth_text(summary: DepthSummary) -> str:
    """Means per hole policy beside those of the constant, with intervals and denominators."""
    coverage, groups = summary.coverage, summary.bootstrap
    rows = []
    for metric, by_policy in summary.metrics.items():
        for policy, value in by_policy.items():
            spread = range_text(summary.intervals[metric][policy].ends)
            constant = summary.constant[metric][policy]
            shown = ["-" if x is None else f"{x:.4f}" for x in (value, constant)]
            rows.append((metric, policy, shown[0], spread, shown[1]))
    evaluator, protocol = summary.evaluator, summary.protocol
    header = ("metric", "holes", "mean", "95 % interval", "constant")
    every = summary.all_attempted
    lines = [
        f"{evaluator.name} {evaluator.version}, camera model {protocol.camera_model}, "
        f"{counted(coverage.attempted, 'image', 'images')} attempted, {coverage.scored} scored, "
        f"{coverage.with_truth} with truth{of_eth3d(coverage)}; intervals over "
        f"{counted(groups.groups, groups.unit, groups.unit + 's')}",
        options.table(header, rows),
        f"over all {counted(every.images, 'image', 'images')} with truth, {every.missing} of them "
        f"without a score at {every.missing_abs_rel:g}: abs_rel "
        + ", ".join(
            f"{policy} {'-' if value is None else format(value, '.4f')}"
            for policy, value in every.abs_rel.items()
        ),
        *_depth_counts(summary),
        *(f"{r.status}: {r.file_name}: {r.reason}" for r in summary.not_scored),
    ]
    return "\n\n".join(lines[:3]) + "".join(f"\n{line}" for line in lines[3:])


def _depth_counts(summary: DepthSummary) -> list[str]:
    """What the means hide: flagged fits, images without ground truth, holes, clamped pixels."""
    by_status = summary.coverage.by_status
    flagged = [f"{by_status.get(name, 0)} {name}" for name in ("inverted", "degenerate", "no_gt")]
    others = [f"{n} {name}" for name, n in by_status.items() if f"{n} {name}" not in flagged]
    shares = {
        "holes": summary.mean_hole_share,
        "outside the view": summary.mean_outside_view_share,
        "clamped": summary.mean_clamped_share,
    }
    return [
        f"images: {', '.join([*others, *flagged])}; "
        f"{summary.worse_than_constant} worse than a constant, "
        f"{summary.resampled} resampled, {counted(summary.warnings, 'warning', 'warnings')}",
        "mean share of truth pixels: "
        + ", ".join(
            f"{name} {'-' if x is None else format(x, '.4f')}" for name, x in shares.items()
        ),
    ]
