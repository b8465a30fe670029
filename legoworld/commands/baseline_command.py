"""`legoworld baseline`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld.commands import options
from legoworld.commands.model_options import model_options
from legoworld.commands.options import Decorator, flag, option
from legoworld.commands.output import Output, table
from legoworld.commands.param_types import (
    AMOUNT,
    COUNT,
    EXISTING,
    EXISTING_FILE,
    Choice,
    TaskChoice,
)
from legoworld.commands.progress import shown_progress
from legoworld.pluralize import plural, share
from legoworld.records.base import UNSET

if TYPE_CHECKING:
    from legoworld.api.readout import Run
    from legoworld.records.run_rows import RunRow
    from legoworld.tables.table import Cell


def _task(text: str) -> Decorator:
    choice = TaskChoice(lambda task: task.family.baseline is not None)
    return option("--task", text, choice, required=True)


def show(run: Run, out: Output) -> int:
    """Print the contents of the run; return the exit code."""
    bad = [row for row in run.rows if row.status != "ok"]
    out.show(
        {"run": str(run.folder), "summary": run.summary, "rows": run.rows},
        _lines(run, bad, verbose=out.verbose),
    )
    return 1 if bad else 0


def _lines(run: Run, bad: list[RunRow], *, verbose: bool) -> Iterator[str]:
    from legoworld.cards import load_card

    summary = run.summary
    if verbose:
        cells = [(row.image_id, row.file_name, row.status, _result_cell(row)) for row in run.rows]
        yield table(("image", "photo", "status", "predicted"), cells) + "\n"
    for row in bad[:50]:
        yield f"{row.status}: {row.file_name} (image {row.image_id}): {row.reason}"
    if len(bad) > 50:
        yield f"... and {len(bad) - 50} more, in {run.folder}/per_image.jsonl"
    coverage = summary.coverage
    line = f"{share(coverage.ok, coverage.attempted, 'image', 'images')} predicted"
    if coverage.ok_empty is not UNSET:
        boxes = load_card(summary.task).reads.startswith("boxes")
        what = ("box", "boxes") if boxes else ("mask", "masks")
        made = plural(summary.predictions or 0, *what)
        line += f" ({coverage.ok_empty} without any), {made}"
    if summary.partial:
        line += ", partial run"
    yield f"{line} -> {run.folder}"


def _result_cell(row: RunRow) -> Cell:
    if row.status != "ok":
        return "-"
    if row.depth and row.rendered_wh:
        width, height = row.rendered_wh
        return f"{row.depth.finite_px / (width * height):.1%} {row.depth.space}"
    return row.n_predictions or 0


@options.group("baseline")
def command() -> None:
    """Run a specialist model over a track's photos, or import results, as a run folder.

    \b
    Examples:
      legoworld baseline install dino
      legoworld baseline run dino --task coco --track track.json --photos val2017 \\
          --weights dino.pth -o runs/dino
      legoworld baseline import results.json --task coco --track track.json -o runs/theirs
    """


@command.command("install")
@click.argument("name")
@option(
    "--torch-index",
    "Package index for torch, such as one with CPU-only or CUDA wheels.",
    metavar="URL",
)
@option("--with extra", "Extra package to install; repeatable.", multiple=True, metavar="PACKAGE")
@options.printing
def install(name: str, torch_index: str | None, extra: tuple[str, ...], out: Output) -> int:
    """Create the environment of the baseline NAME in the user's data folder, replacing any old one.

    Uses uv where it is installed, venv and pip otherwise, and installs only the baseline's own
    requirements. `legoworld doctor` lists the baselines that have an environment.

    \b
    Examples:
      legoworld baseline install dino
      legoworld baseline install da3 --torch-index https://.../whl/cpu
      legoworld baseline install hf-detector --with torchvision==0.28.0 --json
    """
    from legoworld.baselines import environments
    from legoworld.baselines.cards import load_baseline

    card = load_baseline(name)
    python = environments.install(card, out.notice, torch_index=torch_index, extra=extra)
    lacking = environments.problems(card, python)
    out.show(
        {"baseline": name, "python": str(python), "lacking": lacking},
        [*lacking, f"{name} {'is not ready' if lacking else 'is ready'} -> {python}"],
    )
    return 1 if lacking else 0


@command.command("import")
@click.argument("results", type=EXISTING, metavar="SOURCE")
@_task("Task of the results.")
@option("--track", required=True)
@option("--output", "Run folder to write.")
@option("--name", "Name of the baseline [default: SOURCE's name].")
@option(
    "--box-format",
    "Box format, in pixels [default: xywh; xyxy for torchvision's form].",
    Choice(["xywh", "xyxy", "cxcywh"]),
)
@option(
    "--category-ids",
    "Meaning of category ids without names: the dataset's own ids, or positions from 0 or 1.",
    Choice(["dataset", "coco80-0", "coco80-1", "lvis-0"]),
)
@option("--label-map")
@option(
    "--images-run",
    "Images the model was run on: ids or file names [default: every image of the track].",
    EXISTING_FILE,
)
@flag("--subset", "Ignore results of images, or answers to questions, outside the track.")
@option(
    "--space",
    "Depth: quantity in the arrays, where the files do not say. Normals: the arrays are depth, to "
    "which normals are fitted.",
)
@option(
    "--unit",
    "Depth: unit of the arrays: m, mm or m/N such as m/5000; for 16-bit integers mm, m/N, sun_rgbd "
    "or nyu_raw.",
)
@option("--sign")
@option("--array", "Depth, normals: name of the array in an .npz or the channel in an .exr.")
@option(
    "--suffix",
    "Depth, normals: suffix that the files' names add to the photos', such as _pred or _pred.npy.",
)
@option(
    "--intrinsics",
    "Depth: JSON with fx, fy, cx, cy at the arrays' size; converts ray distance to depth, and "
    "depth to normals.",
    EXISTING_FILE,
)
@option("--overwrite", "Replace an existing import in the folder.")
@options.printing
def import_command(results: Path, output: Path, out: Output, **given: Any) -> int:
    """Import SOURCE, a results file or a folder of depth, normals or classes, as a run.

    Input that `legoworld evaluate` would refuse is refused here. Categories and photos are matched
    by name where the results contain names. Arrays mirror the track: <file_name without
    extension>.npy, .npz, .pfm, .exr, .png or .tiff; docs/baselines.md lists the other accepted
    names. An image without an array is recorded as missing. Panoptic results are panopticapi's JSON
    with the folder of its name beside it; classes are PNGs of category ids.

    \b
    Examples:
      legoworld baseline import dino.json --task coco --track track.json --box-format cxcywh \\
          --subset --name DINO -o runs/dino
      legoworld baseline import depths --task eth3d --track eth3d.json --space ray_distance \\
          --unit m --intrinsics camera.json -o runs/depths
      legoworld baseline import dsine --task normals --track track.json \\
          --sign away_from_camera -o runs/dsine
      legoworld baseline import answers.jsonl --task relations --track track.json -o runs/vlm
    """
    from legoworld.api.baselines import baseline_import

    with shown_progress("image", quiet=out.quiet) as listener:
        run = baseline_import(results, output, listener=listener, **given)
    return show(run, out)


@command.command("run")
@click.argument("name")
@_task("What to predict.")
@option("--track", required=True)
@option("--photos")
@option("--output", "Run folder to write.")
@model_options(
    "Seconds from one answer to the next, and for loading the model [default: none].", required=True
)
@option(
    "--load-time-limit load_time_limit_s",
    "Seconds for loading the model [default: --time-limit].",
    AMOUNT,
)
@option("--batch-size", "Images per batch, where the baseline supports it.", COUNT, default=1)
@option("--label-map")
@option(
    "--prompts-from-truth",
    "LVIS only: prompt with each image's verified categories; recorded as used_truth.",
    EXISTING_FILE,
)
@option(
    "--pass-env pass_variables",
    "Environment variable to pass to the baseline; repeatable. Others are hidden from it.",
    multiple=True,
    metavar="NAME",
)
@option("--limit")
@option("--image-id")
@option(
    "--input", "File or folder the baseline may read besides its weights and photos; repeatable."
)
@flag("--resume", "Resume an interrupted run (the default).")
@option("--overwrite")
@options.printing
def run_command(name: str, output: Path, resume: bool, out: Output, **given: Any) -> int:
    """Run the baseline NAME over a track's photos, in its own process.

    Predictions are saved as they are made: re-run the same command to resume, with the same
    weights, options, code and versions. An image that the baseline cannot process, or that crashes
    it twice, is recorded as failed; the exit code is then 1. -v shows the baseline's output.

    With bubblewrap the baseline reads its own files, WEIGHTS, the photos and each --input, writes
    to none of your files, and has the network only to download WEIGHTS that are no path.

    \b
    Examples:
      legoworld baseline run dino --task coco --track track.json --photos val2017 \\
          --weights checkpoint0023_4scale.pth -o runs/dino --device cuda
      legoworld baseline run hf-detector --task coco --track track.json --photos val2017 \\
          --weights PekingU/rtdetr_r50vd -o runs/rtdetr --limit 5
      legoworld baseline run sam3 --task lvis --track lvis.json --photos coco \\
          --weights facebook/sam3 -o runs/sam3 --offline --option per_image=300
    """
    from legoworld.api.baselines import baseline_run

    if resume and given["overwrite"]:
        raise click.UsageError(
            "--resume keeps existing results, --overwrite deletes them: pass one"
        )
    with shown_progress("image", quiet=out.quiet) as listener:
        if out.verbose and not out.quiet:
            listener = replace(listener, log=listener.notice)
        run = baseline_run(name, output, listener=listener, **given)
    return show(run, out)
