"""`legoworld plugin evidence`."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld.commands import options
from legoworld.commands.baseline_output import warn_unconfined
from legoworld.commands.model_options import ModelOptions, model_options
from legoworld.commands.options import flag, option
from legoworld.commands.param_types import EXISTING_FILE, EXISTING_FOLDER, Choice, TaskChoice

if TYPE_CHECKING:
    from legoworld.baselines.photo_provider import ProviderRequest
    from legoworld.plugin.make_evidence import BaselineEvidence, UserEvidence


def _given(task: str | None, **given: Any) -> UserEvidence:
    """What a user brings. task: whose category ids a results file has."""
    from legoworld.api.settings import load_protocol
    from legoworld.plugin.make_evidence import UserEvidence

    protocol = load_protocol(task, None)
    return UserEvidence(vocabulary=protocol.vocabulary if protocol else None, **given)


@click.command("evidence")
@options.together(
    "given",
    _given,
    option("--photo", "The reference photo.", required=True),
    option(
        "--regions",
        "JSON of outlines ({regions: [{name, polygons}]}) or of COCO or LVIS results; repeatable.",
        EXISTING_FILE,
    ),
    option("--image-id image_id", "The photo's id in a results file.", multiple=False),
    option(
        "--task",
        "Whose category ids a results file has.",
        TaskChoice(lambda t: t.family.labelled and t.name == t.dataset.name),
    ),
    option("--depth", "Relative depth: .npy, .npz or .png.", EXISTING_FILE),
    option(
        "--space depth_space",
        "depth: larger is farther; disparity: larger is nearer.",
        Choice(["depth", "disparity"]),
        default="depth",
    ),
    option(
        "--run runs",
        "Folder of `legoworld baseline run` over this photo: masks, boxes or depth; repeatable.",
        EXISTING_FOLDER,
        multiple=True,
    ),
    option(
        "--camera",
        "A provider's camera (format plugin-camera of `legoworld list schema`) instead of --fov.",
        EXISTING_FILE,
    ),
    option(
        "--fov hfov_deg",
        "Horizontal field of view in degrees; with it the camera's rotation is estimated.",
        click.FloatRange(min=1.0, max=170.0),
    ),
)
@option(
    "--provider",
    "Baseline that recovers the photo's camera, and depth with it: vggt, or a folder.",
    metavar="NAME",
)
@model_options(
    "Seconds the provider has to load its model, then for the photo [default: none].",
    required=False,
)
@flag("-v --verbose", "Show the provider's output.")
@option("--output", "Folder to write.")
def evidence(
    given: UserEvidence, provider: str | None, model: ModelOptions, verbose: bool, output: Path
) -> int:
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
    from legoworld.plugin.make_evidence import make_evidence
    from legoworld.workers.scratch import scratch_folder

    if sum(one is not None for one in (given.hfov_deg, given.camera, provider)) > 1:
        raise click.UsageError("--fov, --camera and --provider say the same: pass one of them")
    with scratch_folder("legoworld-provider-") as scratch:
        if provider is not None:
            asked = _request(provider, model)
            given = replace(given, provided=_ask(asked, given.photo, scratch, verbose=verbose))
        else:
            options.refuse_given([*vars(model)], "needs a --provider")
        made = make_evidence(given, output)
    source = made.camera.rotation_source
    rotation = f"rotation from {source}" if source else f"unknown: {made.camera.unknown}"
    click.echo(f"regions  {len(made.regions)}")
    click.echo(f"depth    {made.depth.source if made.depth else 'none'}")
    click.echo(f"camera   {rotation}")
    click.echo(f"evidence {output}")
    return 0


def _request(name: str, model: ModelOptions) -> ProviderRequest:
    from legoworld.baselines.cards import load_baseline
    from legoworld.baselines.photo_provider import ProviderRequest, refuse_without_camera

    card = load_baseline(name)
    refuse_without_camera(card)
    if model.weights is None:
        raise click.UsageError(f"--provider {name} needs --weights: a file, a folder or a hub id")
    return ProviderRequest(**model.chosen(card))


def _ask(
    request: ProviderRequest, photo: Path, scratch: Path, *, verbose: bool
) -> BaselineEvidence:
    """The provider's answer, and a line of what it says of the camera."""
    from legoworld.baselines.photo_provider import ask_provider

    def log(line: str) -> None:
        if verbose:
            click.echo(line, err=True)

    warn_unconfined(request.confined, lambda text: click.echo(text, err=True))
    provided = ask_provider(request, photo, scratch, log)
    seen = provided.camera
    degrees = [
        2 * math.degrees(math.atan(side / 2 / focal))
        for side, focal in ((seen.width, seen.fx), (seen.height, seen.fy))
    ]
    click.echo(
        f"provider {seen.source}: fx {seen.fx:.2f}, fy {seen.fy:.2f}, cx {seen.cx:.2f}, "
        f"cy {seen.cy:.2f} px of {seen.width}x{seen.height}; "
        f"{degrees[0]:.2f} x {degrees[1]:.2f} degrees"
    )
    return provided
