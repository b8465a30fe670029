"""`legoworld baseline import`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import baseline_output, options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING, EXISTING_FILE, Choice
from legoworld.commands.progress import shown_progress

if TYPE_CHECKING:
    from legoworld.baselines.family import BaselineFamily


@click.command("import")
@click.argument("source", type=EXISTING)
@baseline_output.task("Task of the results.")
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
def import_command(
    source: Path,
    task: str,
    track: Path,
    output: Path,
    name: str | None,
    images_run: Path | None,
    subset: bool,
    overwrite: bool,
    out: Output,
    **declared: object,
) -> int:
    """Import SOURCE, a results JSON, answers.jsonl, or a folder of depth or normals, as a run.

    Input that `legoworld evaluate` would refuse is refused here. Categories and photos are matched
    by name where the results contain names. Arrays mirror the track: <file_name without
    extension>.npy, .npz, .pfm, .exr, .png or .tiff; docs/baselines.md lists the other accepted
    names. An image without an array is recorded as missing.

    \b
    Examples:
      legoworld baseline import results.json --task coco --track track.json -o runs/theirs
      legoworld baseline import dino.json --task coco --track track.json --box-format cxcywh \\
          --subset --name DINO -o runs/dino
      legoworld baseline import depths --task eth3d --track eth3d.json --space ray_distance \\
          --unit m --intrinsics camera.json -o runs/depths
      legoworld baseline import dsine --task normals --track track.json \\
          --sign away_from_camera -o runs/dsine
      legoworld baseline import runs/da3/depth --task normals --track track.json \\
          --space depth --intrinsics camera.json -o runs/da3-normals
      legoworld baseline import answers.jsonl --task relations --track track.json -o runs/vlm
    """
    from legoworld.baselines.baseline_import import ImportRequest
    from legoworld.baselines.baseline_import import images_run as read_images_run
    from legoworld.baselines.family import ImportListener, load_baseline_family

    images, protocol = baseline_output.load_track_and_protocol(task, track)
    declared["subset"] = subset or None
    given = {key: value for key, value in declared.items() if value is not None}
    family, reads = load_baseline_family(task), protocol.card.reads
    for key in given:
        if key not in family.options or (key == "box_format" and reads != "boxes"):
            raise click.UsageError(f"--{key.replace('_', '-')} is not for --task {task}")
    _check_depth(given, reads)
    if source.is_dir() != family.of_folder:
        raise click.UsageError(_not_of_the_task(source, task, family))
    request = ImportRequest(
        protocol=protocol,
        track=images,
        run=output,
        name=name or source.resolve().stem,
        ran_on=read_images_run(images_run, images.images) if images_run else None,
        subset=subset,
        overwrite=overwrite,
    )
    with shown_progress("image", quiet=out.quiet) as shown:
        telling = ImportListener(total=shown.total, progress=shown.row, notice=shown.notice)
        result = family.import_answers(request, source, given, telling)
    return baseline_output.show(result, output, out)


def _check_depth(given: Mapping[str, object], reads: str) -> None:
    """click.UsageError for what is declared about depth arrays and cannot hold together."""
    from legoworld.evaluation.depth.integer_units import UNITS, is_unit

    space, unit = given.get("space"), given.get("unit")
    if unit is not None and not is_unit(str(unit)):
        raise click.UsageError(f"--unit {unit!r} is not one of {UNITS}")
    if space == "disparity" and unit:
        raise click.UsageError("--unit is for depth: disparity has an unknown scale and shift")
    if space in ("depth", "disparity") and "intrinsics" in given and reads == "depth":
        raise click.UsageError(f"--intrinsics is for ray distance, not for --space {space}")


def _not_of_the_task(source: Path, task: str, family: BaselineFamily) -> str:
    from legoworld.baselines.foreign_results import next_step_for

    what = f"--task {task} imports {family.what}"
    if family.of_folder:
        return what
    advice = next_step_for(source)
    what += f", but {source.name} is a folder"
    if (source / "run.json").is_file():
        return f"{what}: it is already a run, evaluate it directly"
    return what + (f": {advice}" if advice else "")
