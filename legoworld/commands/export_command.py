"""`legoworld export`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FOLDER, FILE, Choice
from legoworld.pluralize import plural


@click.command("export")
@click.argument("run", type=EXISTING_FOLDER)
@option("--format form", "Output format.", Choice(["coco", "kins"]), default="coco")
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
    form: Literal["coco", "kins"],
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

    \b
    Examples:
      legoworld export runs/coco -o coco.json
      legoworld export runs/amodal --format kins -o truth.json
      legoworld export runs/masks --format coco --track track.json -o masks.json
    """
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
