"""`legoworld score`."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING, TaskChoice, has_track
from legoworld.pluralize import plural
from legoworld.tasks.shipped import DEFAULT

if TYPE_CHECKING:
    from legoworld.api.one_photo import PhotoScore
    from legoworld.records.base import Storable


#: Maximum number of findings without -v; the costliest come first.
_SHORT = 5


@click.command("score")
@click.argument("program_or_scene", type=EXISTING)
@option("--photo", "Photo that the scene reconstructs.", required=True)
@option("--truth")
@option("--task", "Task to read out and score.", TaskChoice(has_track), default=DEFAULT)
@option("--image", "The photo's id or file name in the ground truth [default: its own name].")
@option("--source")
@option(
    "--output",
    "Folder for the scene, run, evaluation, overlay and report [default: only the overlay is "
    "kept, in legoworld-runs].",
    required=False,
)
@options.cache
@options.limits
@options.printing
def command(
    program_or_scene: Path, photo: Path, task: str, output: Path | None, out: Output, **given: Any
) -> int:
    """Score one PROGRAM_OR_SCENE against one photo's ground truth.

    PROGRAM_OR_SCENE: a .py, any .blend or .glb, or a scene folder.

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
    from legoworld.api.listener import Listener
    from legoworld.api.score import score_photo
    from legoworld.workers.scratch import scratch_folder

    with scratch_folder("legoworld-score-") as scratch:
        found = score_photo(
            program_or_scene,
            output or scratch / "score",
            photo=photo,
            task=task,
            listener=Listener(notice=out.step, trace=out.trace),
            **given,
        )
        overlay = found.overlay
        if overlay is not None and output is None:
            overlay = _kept_overlay(overlay, photo, task)
    out.show(lambda: _document(found, overlay), _lines(found, overlay, output, out))
    return exit_codes.DONE if found.row.status == "ok" else exit_codes.INCOMPLETE


def _kept_overlay(overlay: Path, photo: Path, task: str) -> Path:
    kept = Path("legoworld-runs") / f"{photo.stem}-{task}-overlay.png"
    kept.parent.mkdir(exist_ok=True)
    shutil.copyfile(overlay, kept)
    return kept


def _document(score: PhotoScore, overlay: Path | None) -> dict[str, Storable]:
    return {
        "row": score.row,
        "summary": score.summary,
        "advice": list(score.advice),
        "execution": score.execution
        and {"status": score.execution.status, "error": score.execution.error},
        "overlay": str(overlay) if overlay else None,
    }


def _lines(
    score: PhotoScore, overlay: Path | None, output: Path | None, out: Output
) -> Iterator[str]:
    from legoworld.evaluation.family import load_evaluation_family

    row = score.row
    if score.execution is not None and score.execution.error is not None:
        error = score.execution.error
        yield (
            f"the program stopped at line {error.line}: {error.type}: {error.message}; "
            "the partial scene is scored"
        )
    if score.summary is None:
        yield f"{row.status}: {row.file_name}: {row.reason}"
        return
    yield load_evaluation_family(score.summary.task).short(score.summary)
    names = tuple(f"the label {u.label!r} " for u in row.unmatched or ())
    later = [one for one in score.advice[_SHORT:] if out.verbose or one.what.startswith(names)]
    shown = [*score.advice[:_SHORT], *later]
    for one in shown:
        yield f"{one.level}: {one.what}" + (f"; do: {one.do}" if one.do else "")
    if len(shown) < len(score.advice):
        more = plural(len(score.advice) - len(shown), "finding", "findings")
        yield f"... and {more} more (-v lists them)"
    if overlay is not None:
        yield f"overlay -> {overlay}"
    if output is not None:
        yield f"report -> {output / 'report.html'}"
    else:
        out.notice("-o FOLDER keeps the scene, the run, the evaluation and a report")
