"""`legoworld export`."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FOLDER, FILE, Choice
from legoworld.pluralize import plural

#: From this tilt on, it is said what KITTI's boxes lose.
LEVEL_DEG: Final = 0.5
FORMATS: Final = ("coco", "kins", "omni3d", "kitti")


@click.command("export")
@click.argument("run", type=EXISTING_FOLDER)
@option("--format form", "Output format.", Choice(FORMATS), default="coco")
@option(
    "--output", "File to write [default: legoworld-runs/<RUN>-coco.json].", FILE, required=False
)
@option(
    "--track",
    "The run's track, where its categories are not the dataset's own [default: those predicted].",
)
@option("--overwrite", "Replace an existing file.")
@options.printing_json
def command(
    run: Path,
    form: Literal["coco", "kins", "omni3d", "kitti"],
    output: Path | None,
    track: Path | None,
    overwrite: bool,
    out: Output,
) -> int:
    """Write the boxes or masks of a RUN as one COCO JSON for dataset tools.

    The file is a complete dataset: images, categories, and each prediction as an annotation with
    bbox, area, segmentation (compressed RLE; empty for boxes), iscrowd 0 and score. Tools that read
    it: pycocotools, torchvision's CocoDetection, FiftyOne, supervision (boxes). Annotations from a
    scene have the names of their objects under `attributes`.

    kins, of amodal masks, adds the visible parts: inmodal_seg, inmodal_bbox, a_area, i_area and
    occlude_rate. `evaluate` reads such a file as ground truth.

    omni3d, of boxes in space, is one JSON in Omni3D's form, which `evaluate` reads as ground truth;
    kitti is a folder of label_2/ and calib/, one text file a photo.

    \b
    Examples:
      legoworld export runs/coco -o coco.json
      legoworld export runs/amodal --format kins -o truth.json
      legoworld export runs/boxes3d --format omni3d -o truth.json
      legoworld export runs/masks --format coco --track track.json -o masks.json
    """
    output = output or Path("legoworld-runs") / f"{run.resolve().name}-{form}.json"
    if form == "omni3d" or form == "kitti":
        from legoworld.api.boxes3d_export import export_boxes3d

        made = export_boxes3d(run, output, form=form, track=track, overwrite=overwrite)
        if form == "kitti" and made.tilt_deg > LEVEL_DEG:
            out.notice(
                f"KITTI's boxes turn about the camera's vertical alone: up to {made.tilt_deg:.1f} "
                "degrees of tilt are lost; omni3d keeps them"
            )
        n_images, n_annotations = made.images, made.annotations
        shown = {"images": n_images, "annotations": n_annotations}
        out.show(
            {"format": form, "output": str(output), **shown},
            f"{plural(n_annotations, 'box', 'boxes')} of {plural(n_images, 'image', 'images')} "
            f"-> {output}",
        )
        return 0
    from legoworld.api.coco_export import export

    output = output or Path("legoworld-runs") / f"{run.resolve().name}-{form}.json"
    document = export(run, output, format=form, track=track, overwrite=overwrite)
    n_images, n_annotations = len(document.images), len(document.annotations)
    out.show(
        {"format": form, "output": str(output), "images": n_images, "annotations": n_annotations},
        f"{plural(n_annotations, 'annotation', 'annotations')} of "
        f"{plural(n_images, 'image', 'images')} -> {output}",
    )
    return 0
