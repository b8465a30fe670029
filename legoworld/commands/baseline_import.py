"""`legoworld baseline import`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from legoworld.commands import baseline_output, options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING, EXISTING_FILE, Choice
from legoworld.commands.progress import shown_progress


@click.command("import")
@click.argument("results", type=EXISTING, metavar="SOURCE")
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
@option("--space", "Depth: quantity in the arrays, where the files do not say.")
@option(
    "--unit",
    "Depth: unit of the arrays: m, mm or m/N such as m/5000; for 16-bit integers mm, m/N, sun_rgbd "
    "or nyu_raw.",
)
@option(
    "--sign",
    "Normals: which way they point, where the files do not say; a frontal wall is (0, 0, -1) "
    "towards the camera.",
    Choice(["towards_camera", "away_from_camera"]),
)
@option("--array", "Depth, normals: name of the array in an .npz or the channel in an .exr.")
@option(
    "--suffix",
    "Depth, normals: suffix that the files' names add to the photos', such as _pred or _pred.npy.",
)
@option(
    "--intrinsics",
    "Depth: JSON with fx, fy, cx, cy at the arrays' size; converts ray distance to depth.",
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
    return baseline_output.show(run, out)
