"""`legoworld export`."""

from __future__ import annotations

from pathlib import Path

import click

from legoworld.commands import options
from legoworld.pluralize import counted


@click.command("export", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("run", type=options.EXISTING_FOLDER)
@click.option(
    "--format",
    "form",
    type=options.Choice(["coco"]),
    default="coco",
    show_default=True,
    help="Output format.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to write.",
)
@click.option(
    "--track",
    type=options.EXISTING_FILE,
    help="The run's track, for category names other than the dataset's own.",
)
@click.option("--overwrite", is_flag=True, help="Replace an existing file.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(
    run: Path, form: str, output: Path, track: Path | None, overwrite: bool, as_json: bool
) -> int:
    """Write the boxes or masks of a RUN as one COCO JSON for dataset tools.

    The file is a complete dataset: images, categories, and each prediction as an annotation with
    bbox, area, segmentation (compressed RLE; empty for boxes), iscrowd 0 and score. Tools that read
    it: pycocotools, torchvision's CocoDetection, FiftyOne, supervision (boxes). Annotations from a
    scene have the names of their objects under `attributes`.

    \b
    Examples:
      legoworld export runs/coco -o coco.json
      legoworld export runs/masks --format coco --track track.json -o masks.json
    """
    from legoworld.api.coco_export import export_coco

    document = export_coco(run, output, track=track, overwrite=overwrite)
    n_images, n_annotations = len(document.images), len(document.annotations)
    if as_json:
        options.print_json({"format": form, "output": str(output), "images": n_images,
                            "annotations": n_annotations})  # fmt: skip
    else:
        of = counted(n_images, "image", "images")
        click.echo(f"{counted(n_annotations, 'annotation', 'annotations')} of {of} -> {output}")
    return 0
