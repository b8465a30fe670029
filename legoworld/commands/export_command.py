"""`legoworld export`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FOLDER, Choice, TaskChoice
from legoworld.exports.formats import FORMAT_NAMES, ExportResult, find_format
from legoworld.pluralize import plural


@click.command("export")
@click.argument("run_or_scenes", type=EXISTING_FOLDER)
@option("--format", "Output format.", Choice(FORMAT_NAMES), default="coco")
@option(
    "--output",
    "File or folder to write [default: legoworld-runs/<NAME>-<FORMAT>].",
    click.Path(path_type=Path),
    required=False,
)
@option(
    "--task",
    "Of scenes: task whose vocabulary resolves the labels [default: every label counts].",
    TaskChoice(lambda task: task.family.labelled),
)
@option(
    "--track",
    "Of a run: for category names other than the dataset's own. Of scenes: whose vocabulary "
    "resolves the labels.",
)
@option("--size", "Of scenes: image size, such as 640x480 [default: each scene's own].")
@option("--source")
@option("--require-frozen")
@option("--overwrite", "Replace an existing file, or a folder of an earlier export.")
@options.cache
@options.limits
@options.printing_json
def command(
    run_or_scenes: Path,
    format: str,  # noqa: A002
    output: Path | None,
    out: Output,
    **given: Any,
) -> int:
    """Write a run, or what the cameras of scenes see, in the format of other tools.

    From a RUN: coco (boxes or masks), kins (amodal masks), lvis (LVIS masks), panoptic (segments),
    omni3d and kitti (boxes in space). A COCO file is a complete dataset: images, categories, and
    each prediction as an annotation with bbox, area, segmentation (compressed RLE; empty for
    boxes), iscrowd 0 and score.

    From SCENES (one scene folder, or a folder of them): kitti; bop (poses, models, masks, depth,
    in millimetres); replicator (BasicWriter's files); usd (the scene with semantic labels).

    What a format cannot hold is printed. docs/exports.md describes each.

    \b
    Examples:
      legoworld export runs/coco -o coco.json
      legoworld export runs/amodal --format kins -o truth.json
      legoworld export scenes --format bop --task lvis -o bop
      legoworld export scenes/coffee --format usd -o usd
    """
    from legoworld.api.exporting import export, is_run

    if output is None:
        suffix = ".json" if find_format(format).views is None else ""
        name = f"{run_or_scenes.resolve().name}-{format}{suffix}"
        output = Path("legoworld-runs") / name
    if is_run(run_or_scenes):
        names = ["task", "size_wh", "source", "require_frozen"]
        options.refuse_given(names, "is for scenes: a run has its own")
    made = export(run_or_scenes, output, format=format, **given)
    written = (
        made
        if isinstance(made, ExportResult)
        else ExportResult(images=len(made.images), annotations=len(made.annotations))
    )
    for lost in written.losses:
        out.notice(f"{format} does not hold: {lost}")
    for name, error in written.failed.items():
        out.notice(f"{name}: {error}")
    out.show(
        {
            "format": format,
            "output": str(output),
            "images": written.images,
            "annotations": written.annotations,
            "not_held": written.losses,
            "failed": sorted(written.failed),
        },
        f"{plural(written.annotations, 'annotation', 'annotations')} of "
        f"{plural(written.images, 'image', 'images')} -> {output}",
    )
    return exit_codes.INCOMPLETE if written.failed else exit_codes.DONE
