"""`legoworld evaluate`."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import click

from legoworld import exit_codes
from legoworld.api.by_task import task_entry, tasks_below
from legoworld.api.listener import Listener
from legoworld.commands import options
from legoworld.commands.options import off, option
from legoworld.commands.output import Output, on_terminal, report_hint
from legoworld.commands.param_types import EXISTING_SCENES, PLACE, Choice
from legoworld.files import readable_json, refuse_existing, write_text
from legoworld.records.folders.read_run import RUN
from legoworld.remote import Place
from legoworld.tasks.registry import task_names

if TYPE_CHECKING:
    from click._termui_impl import ProgressBar

    from legoworld.api.evaluation import Evaluation, EvaluationOptions
    from legoworld.records.evaluation import EvaluationRow


_NOT_OF_POSES = (
    "evaluator", "camera_model", "reference_sampling", "diagnostics", "draws", "seed", "workers",
    "engine",
)  # fmt: skip


@click.command("evaluate")
@click.argument("run", type=EXISTING_SCENES)
@option(
    "--truth truths",
    "Ground truth: COCO or LVIS JSON, ETH3D's folder, or a bench's DATASET/private. For a folder "
    "of runs: TASK=PATH, repeatable, or a folder with <task>.json or <task>/ of each.",
    click.STRING,
    multiple=True,
    metavar="PATH",
)
@option(
    "--output",
    "Evaluation folder to write, or its URL; of a folder of runs the folder of theirs.",
    PLACE,
)
@option(
    "--evaluator",
    "pycocotools and lvis, or hotcoco [default: official, where it is installed].",
    Choice(["official", "fast"]),
)
@option(
    "--camera-model",
    "Depth only: warp a scene's pinhole depth through the dataset's camera [default: none].",
    Choice(["none", "dataset"]),
)
@option(
    "--reference-sampling",
    "Bench only: raster, all full-size pixels, or random:SEED of them [default: raster].",
    metavar="SAMPLING",
)
@off("--no-diagnostics diagnostics", "Bench only: V, R, A, S without the numbers beside R.")
@option("--draws", "Number of tie orders and of bootstrap samples [default: 2000, bench 10000].")
@option("--seed")
@option("--workers", "Worker processes [default: cores].")
@option("--engine")
@option("--overwrite", "Replace an existing evaluation in the folder.")
@options.printing
def command(
    run: Place,
    truths: tuple[str, ...],
    output: Place,
    out: Output,
    **given: Unpack[EvaluationOptions],
) -> int:
    """Score a RUN, or each run of a folder RUN/<task>, against private ground truth.

    Boxes and masks are scored by the unmodified official evaluator over every image the run
    attempted. -v prints the evaluator's own lines, then every metric with its interval and
    denominator. The folder contains ground truth: keep it private. --engine and --workers
    distribute the work and do not change any output byte. RUN may also be a BOP results file
    of poses (CSV), and --truth the BOP dataset: OUTPUT/poses.json has their errors.

    \b
    Examples:
      legoworld evaluate runs/coco --truth instances_val2017.json -o evals/coco
      legoworld evaluate runs --truth coco=instances_val2017.json --truth lvis=lvis.json -o evals
      legoworld evaluate s3://bucket/run --truth lvis_v1_val.json -o s3://private/eval
      legoworld evaluate mine_lm-test.csv --truth bop/lm -o evals/poses
    """
    if isinstance(run, Path) and run.is_file():
        options.refuse_given(_NOT_OF_POSES, "is not for poses")
        return _score_poses(
            run, parse_truths(run, truths), output, out, given.get("overwrite", False)
        )
    from legoworld.api.evaluation import Evaluation, evaluate

    with _open_listener(out) as given["listener"]:
        evaluation = evaluate(run, output, truth=parse_truths(run, truths), **given)
    evaluations = [evaluation] if isinstance(evaluation, Evaluation) else list(evaluation.values())
    out.show(evaluation.to_dict, _lines(evaluations, evaluation.folder, verbose=out.verbose))
    return exit_codes.DONE


def _score_poses(
    results: Path, dataset: Path | dict[str, Path], output: Place, out: Output, overwrite: bool
) -> int:
    """Score a results file of poses; write OUTPUT/poses.json."""
    from legoworld.evaluation.pose.score import score_poses

    if not isinstance(output, Path) or not isinstance(dataset, Path):
        raise click.UsageError("poses take one --truth and a local output folder")
    file = output / "poses.json"
    refuse_existing(file, overwrite=overwrite)
    scores = asdict(score_poses(dataset, results))
    output.mkdir(parents=True, exist_ok=True)
    write_text(file, readable_json(scores))
    numbers = {name: value for name, value in scores.items() if name != "errors"}
    recalls = ", ".join(f"{name} {scores[name]:.4f}" for name in scores if name.startswith("ar"))
    out.show(
        numbers, f"{scores['n_estimates']} poses of {scores['n_truths']}: {recalls}\n-> {file}"
    )
    return exit_codes.DONE


def _lines(evaluations: list[Evaluation], folder: Place, *, verbose: bool) -> Iterator[str]:
    from legoworld.evaluation.family import evaluation_text, load_evaluation_family

    for one in evaluations:
        if len(evaluations) > 1:
            yield f"{one.task}:"
        if verbose:
            yield f"{evaluation_text(one.summary)}\n\n-> {one.folder}"
        else:
            yield f"{load_evaluation_family(one.task).short(one.summary)}\n-> {one.folder}"
    if isinstance(folder, Path):
        yield report_hint(
            folder, photos=any(load_evaluation_family(one.task).photos for one in evaluations)
        )


@contextmanager
def _open_listener(out: Output) -> Iterator[Listener]:
    """Notices on a terminal or with -v; a progress bar there if images are scored one by one."""
    if out.quiet or not on_terminal():
        yield Listener(notice=out.step, warn=out.notice)
        return
    images = failed = 0
    with ExitStack() as stack:
        bar: ProgressBar[int] | None = None

        def total(n: int) -> None:
            nonlocal images
            images = n

        def count_scored(row: EvaluationRow) -> None:
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

        yield Listener(total=total, scored=count_scored, notice=out.step, warn=out.notice)


def parse_truths(run: Place, texts: Sequence[str]) -> Path | dict[str, Path]:
    """What `evaluate` takes as its truth. click.UsageError for texts that cannot be used.

    Of a folder of runs, every run needs a truth where --truth is a folder; TASK=PATH selects runs.
    """
    named = dict(text.split("=", 1) for text in texts if text.partition("=")[0] in task_names())
    if len(named) == len(texts):
        return {task: _require_existing(path) for task, path in named.items()}
    if named or len(texts) > 1:
        raise click.UsageError("--truth is one path, or TASK=PATH once for each task")
    path = _require_existing(texts[0])
    tasks = tasks_below(run, RUN) if isinstance(run, Path) else []
    if not tasks:
        return path
    if not path.is_dir():
        raise click.UsageError(
            f"{run} holds the runs of {', '.join(tasks)}: pass --truth TASK=PATH for each, or a "
            "folder with <task>.json or <task>/ of each"
        )
    return {task: task_entry(path, task, "ground truth") for task in tasks}


def _require_existing(path: str) -> Path:
    if not Path(path).exists():
        raise click.BadParameter(f"Path {path!r} does not exist.", param_hint="'--truth'")
    return Path(path)
