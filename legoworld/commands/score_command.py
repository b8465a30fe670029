"""`legoworld score`."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.pluralize import counted
from legoworld.tasks.shipped import DEFAULT

if TYPE_CHECKING:
    from legoworld.api.one_photo import PhotoScore
    from legoworld.records.base import Storable

#: Maximum number of findings without -v; the costliest come first.
_SHORT = 5


@click.command("score", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("program_or_scene", type=click.Path(path_type=Path, exists=True))
@click.option(
    "--photo", required=True, type=options.EXISTING_FILE, help="Photo that the scene reconstructs."
)
@click.option(
    "--truth",
    required=True,
    type=click.Path(path_type=Path, exists=True),
    help="Ground truth: COCO or LVIS JSON, or a folder of measured depth.",
)
@click.option(
    "--task",
    type=options.TaskChoice(options.has_track),
    default=DEFAULT,
    show_default=True,
    help="Task to read out and score.",
)
@click.option(
    "--image", help="The photo's id or file name in the ground truth [default: its own name]."
)
@options.source
@click.option(
    "-o",
    "--output",
    type=options.FOLDER,
    help="Folder for the scene, run, evaluation, overlay and report [default: only the overlay is "
    "kept, in legoworld-runs].",
)
@options.caching
@options.limits
@options.output_options
def command(
    program_or_scene: Path,
    photo: Path,
    truth: Path,
    task: str,
    image: str | None,
    source: Literal["blend", "glb"],
    output: Path | None,
    cache: Path | None,
    no_cache: bool,
    time_limit: float,
    memory_limit: float,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Score one PROGRAM_OR_SCENE, a .py or a scene folder, against one photo's ground truth.

    Does in one command what execute, track make, readout, inspect, evaluate and report do for a
    set: prints the numbers of this photo, what to fix, and where the overlay is. It is an
    evaluation and reads ground truth, so an agent that builds scenes must not run it or see its
    output. A scene folder is only read. Exit code 1 when the scene has no result.

    \b
    Examples:
      legoworld score coffee.py --photo coffee.png --truth truth_coco.json
      legoworld score scenes/coffee --photo coffee.png --truth truth_lvis.json --task lvis -o look
      legoworld score scenes/000000000139 --photo 139.jpg --image 139 --truth instances.json
    """
    from legoworld.api.one_photo import PhotoRequest, score_photo
    from legoworld.api.settings import limits_of, snapshot_cache
    from legoworld.workers.scratch import scratch_folder

    if not program_or_scene.is_dir() and program_or_scene.suffix not in (".py", ".blend"):
        raise click.UsageError(
            f"{program_or_scene} is not a .py, a scene folder or its scene.blend; to read a "
            "scene.glb, pass its folder with --source glb"
        )
    with scratch_folder("legoworld-score-") as scratch:
        folder = output or scratch / "score"
        kept = options.cache_choice(cache, no_cache) or scratch / "snapshots"
        score = score_photo(
            PhotoRequest(
                program_or_scene=program_or_scene,
                photo=photo,
                truth=truth,
                task=task,
                image=image,
                source=source,
                cache=snapshot_cache(kept),
                limits=limits_of(time_limit, memory_limit),
            ),
            folder,
            options.notifier(quiet or not (verbose or options.on_terminal())),
            options.tracer(verbose),
        )
        overlay = score.overlay
        if overlay is not None and output is None:
            overlay = _kept_overlay(overlay, photo, task)
    if as_json:
        options.print_json(_document(score, overlay))
    else:
        _print(score, overlay, output, verbose=verbose, quiet=quiet)
    return exit_codes.DONE if score.row.status == "ok" else exit_codes.INCOMPLETE


def _kept_overlay(overlay: Path, photo: Path, task: str) -> Path:
    kept = Path("legoworld-runs") / f"{photo.stem}-{task}-overlay.png"
    kept.parent.mkdir(exist_ok=True)
    shutil.copyfile(overlay, kept)
    return kept


def _document(found: PhotoScore, overlay: Path | None) -> dict[str, Storable]:
    return {
        "row": found.row,
        "summary": found.summary,
        "advice": list(found.advice),
        "execution": found.execution
        and {"status": found.execution.status, "error": found.execution.error},
        "overlay": str(overlay) if overlay else None,
    }


def _print(
    found: PhotoScore, overlay: Path | None, output: Path | None, *, verbose: bool, quiet: bool
) -> None:
    from legoworld.evaluation.family import evaluation_of

    row = found.row
    if found.execution is not None and found.execution.error is not None:
        error = found.execution.error
        click.echo(
            f"the program stopped at line {error.line}: {error.type}: {error.message}; "
            "the partial scene is scored"
        )
    if found.summary is None:
        click.echo(f"{row.status}: {row.file_name}: {row.reason}")
        return
    click.echo(evaluation_of(found.summary.task).short(found.summary))
    shown = found.advice if verbose else found.advice[:_SHORT]
    for one in shown:
        click.echo(f"{one.level}: {one.what}" + (f"; do: {one.do}" if one.do else ""))
    if len(shown) < len(found.advice):
        more = counted(len(found.advice) - len(shown), "finding", "findings")
        click.echo(f"... and {more} more (-v lists them)")
    if overlay is not None:
        click.echo(f"overlay -> {overlay}")
    if output is not None:
        click.echo(f"report -> {output / 'report.html'}")
    elif not quiet:
        click.echo("-o FOLDER keeps the scene, the run, the evaluation and a report", err=True)
