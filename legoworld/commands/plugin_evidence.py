"""`legoworld plugin evidence`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from legoworld.commands import model_options, options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FILE, EXISTING_FOLDER, Choice, TaskChoice


@click.command("evidence")
@option("--photo", "The reference photo.", required=True)
@option(
    "--regions",
    "JSON of outlines ({regions: [{name, polygons}]}) or of COCO or LVIS results; repeatable.",
    EXISTING_FILE,
)
@option("--image-id photo_id", "The photo's id in a results file.", multiple=False)
@option(
    "--task",
    "Whose category ids a results file has.",
    TaskChoice(lambda t: t.family.labelled and t.name == t.dataset.name),
)
@option("--depth", "Relative depth: .npy, .npz or .png.", EXISTING_FILE)
@option(
    "--space depth_space",
    "depth: larger is farther; disparity: larger is nearer.",
    Choice(["depth", "disparity"]),
    default="depth",
)
@option(
    "--run runs",
    "Folder of `legoworld baseline run` over this photo: masks, boxes or depth; repeatable.",
    EXISTING_FOLDER,
    multiple=True,
)
@option(
    "--camera",
    "A provider's camera (format plugin-camera of `legoworld list schema`) instead of --fov.",
    EXISTING_FILE,
)
@option(
    "--fov hfov_deg",
    "Horizontal field of view in degrees; with it the camera's rotation is estimated.",
    click.FloatRange(min=1.0, max=170.0),
)
@option(
    "--provider",
    "Baseline that recovers the photo's camera, and depth with it: vggt, or a folder.",
    metavar="NAME",
)
@model_options.model_options(
    "Seconds the provider has to load its model, then for the photo [default: none].",
    required=False,
)
@flag("-v --verbose", "Show the provider's output.")
@option("--output", "Folder to write.")
def evidence(output: Path, verbose: bool, provider: str | None, **given: Any) -> int:
    """Gather what a photo says about its scene: regions, relative depth, camera rotation.

    Everything comes from the photo and from models that looked at it; never from ground truth. A
    provider gives the intrinsics; up is estimated from vanishing points, or unknown.

    \b
    Examples:
      legoworld plugin evidence --photo room.jpg --regions outlines.json -o evidence
      legoworld plugin evidence --photo 139.jpg --regions sam3/predictions.json --task lvis \\
        --image-id 139 --depth depth/139.npz --space disparity --fov 60 -o evidence
      legoworld plugin evidence --photo 139.jpg --run sam3-run --run da3-run --fov 60 -o evidence
      legoworld plugin evidence --photo room.jpg --provider vggt --weights facebook/VGGT-1B \\
        --device auto --regions outlines.json -o evidence
    """
    from legoworld.api.listener import Listener
    from legoworld.api.plugin_evidence import plugin_evidence

    if provider is None:
        options.refuse_given(model_options.NAMES, "needs a --provider")
    out = Output(verbose=verbose)
    made = plugin_evidence(
        output,
        provider=provider,
        listener=Listener(notice=click.echo, warn=out.warn, log=out.trace),
        **given,
    )
    source = made.camera.rotation_source
    rotation = f"rotation from {source}" if source else f"unknown: {made.camera.unknown}"
    click.echo(f"regions  {len(made.regions)}")
    click.echo(f"depth    {made.depth.source if made.depth else 'none'}")
    click.echo(f"camera   {rotation}")
    click.echo(f"evidence {output}")
    return 0
