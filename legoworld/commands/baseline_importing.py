"""`legoworld baseline import`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import baseline_output, options
from legoworld.commands.progress import shown_progress

if TYPE_CHECKING:
    from legoworld.baselines.box_formats import BoxFormat
    from legoworld.baselines.category_ids import CategoryIds
    from legoworld.baselines.family import BaselineFamily


@click.command("import", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("source", type=click.Path(path_type=Path, exists=True))
@click.option("--task", required=True, type=baseline_output.TASKS, help="Task of the results.")
@click.option("--track", required=True, type=options.EXISTING_FILE, help="Track file (images).")
@click.option("-o", "--output", type=options.FOLDER, required=True, help="Run folder to write.")
@click.option("--name", help="Name of the baseline [default: SOURCE's name].")
@click.option(
    "--box-format",
    type=options.Choice(["xywh", "xyxy", "cxcywh"]),
    help="Box format, in pixels [default: xywh; xyxy for torchvision's form].",
)
@click.option(
    "--category-ids",
    type=options.Choice(["dataset", "coco80-0", "coco80-1", "lvis-0"]),
    help="Meaning of category ids without names: the dataset's own ids, or positions from 0 or 1.",
)
@click.option(
    "--label-map", type=options.EXISTING_FILE, help='JSON {"their label": "category name" or null}.'
)
@click.option(
    "--images-run",
    type=options.EXISTING_FILE,
    help="Images the model was run on: ids or file names [default: every image of the track].",
)
@click.option("--subset", is_flag=True, help="Ignore results of images outside the track.")
@click.option(
    "--space",
    type=options.Choice(["depth", "disparity", "ray_distance"]),
    help="Depth: quantity in the arrays, where the files do not say.",
)
@click.option(
    "--unit",
    help="Depth: unit of the arrays: m, mm or m/N such as m/5000; for 16-bit integers mm, m/N, "
    "sun_rgbd or nyu_raw.",
)
@click.option("--array", help="Depth: name of the array in an .npz or the channel in an .exr.")
@click.option(
    "--suffix",
    help="Depth: suffix that the files' names add to the photos', such as _pred or _pred.npy.",
)
@click.option(
    "--intrinsics",
    type=options.EXISTING_FILE,
    help="Depth: JSON with fx, fy, cx, cy at the arrays' size; converts ray distance to depth.",
)
@click.option("--overwrite", is_flag=True, help="Replace an existing import in the folder.")
@options.output_options
def import_command(
    source: Path,
    task: str,
    track: Path,
    output: Path,
    name: str | None,
    box_format: BoxFormat | None,
    category_ids: CategoryIds | None,
    label_map: Path | None,
    images_run: Path | None,
    subset: bool,
    space: str | None,
    unit: str | None,
    array: str | None,
    suffix: str | None,
    intrinsics: Path | None,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Import SOURCE, a results JSON or a folder of depth arrays, as a run.

    Input that `legoworld evaluate` would refuse is refused here. Categories and photos are matched
    by name where the results contain names. Depth arrays mirror the track: <file_name without
    extension>.npy, .npz, .pfm, .exr, .png or .tiff; docs/baselines.md lists the other accepted
    names. An image without an array is recorded as missing.

    \b
    Examples:
      legoworld baseline import results.json --task coco --track track.json -o runs/theirs
      legoworld baseline import dino.json --task coco --track track.json --box-format cxcywh \\
          --subset --name DINO -o runs/dino
      legoworld baseline import depths --task eth3d --track eth3d.json --space ray_distance \\
          --unit m --intrinsics camera.json -o runs/depths
    """
    from legoworld.baselines.baseline_import import ImportRequest
    from legoworld.baselines.baseline_import import images_run as read_images_run
    from legoworld.baselines.family import Telling, baseline_of

    images, protocol = baseline_output.track_of(task, track)
    given: dict[str, object] = {
        "box_format": box_format, "category_ids": category_ids, "label_map": label_map,
        "subset": subset or None, "space": space, "unit": unit, "intrinsics": intrinsics,
        "array": array, "suffix": suffix,
    }  # fmt: skip
    given = {name: value for name, value in given.items() if value is not None}
    family, reads = baseline_of(task), protocol.card.reads
    for name in given:
        if name not in family.options or (name == "box_format" and reads != "boxes"):
            raise click.UsageError(f"--{name.replace('_', '-')} is not for --task {task}")
    if unit is not None:
        _check_unit(unit)
    if space == "disparity" and unit:
        raise click.UsageError("--unit is for depth: disparity has an unknown scale and shift")
    if space in ("depth", "disparity") and intrinsics:
        raise click.UsageError(f"--intrinsics is for ray distance, not for --space {space}")
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
    with shown_progress("image", quiet=quiet) as shown:
        telling = Telling(total=shown.total, progress=shown.row, notice=shown.notice)
        result = family.import_answers(request, source, given, telling)
    return baseline_output.show(result, output, as_json=as_json, verbose=verbose)


def _check_unit(unit: str) -> None:
    from legoworld.evaluation.depth.integer_units import UNITS, is_unit

    if not is_unit(unit):
        raise click.UsageError(f"--unit {unit!r} is not one of {UNITS}")


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
