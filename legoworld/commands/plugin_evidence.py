"""`legoworld plugin evidence`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from legoworld.commands import options
from legoworld.commands.baseline_output import sandbox_option, warn_unconfined

if TYPE_CHECKING:
    from legoworld.baselines.photo_provider import ProviderRequest
    from legoworld.plugin.evidence_making import Provided
    from legoworld.workers.protections import Confinement

_CONTEXT = {"help_option_names": ["-h", "--help"]}
#: Parameters that say how a provider is run.
_OF_PROVIDER = (
    "weights", "python", "device", "dtype", "chosen", "offline", "time_limit", "sandbox",
)  # fmt: skip


@click.command("evidence", context_settings=_CONTEXT)
@click.option("--photo", required=True, type=options.EXISTING_FILE, help="The reference photo.")
@click.option(
    "--regions", multiple=True, type=options.EXISTING_FILE,
    help="JSON of outlines ({regions: [{name, polygons}]}) or of COCO or LVIS results; repeat.",
)  # fmt: skip
@click.option("--image-id", type=int, help="The photo's id in a results file.")
@click.option(
    "--task", type=options.TaskChoice(lambda t: t.family.labelled and t.name == t.dataset.name),
    help="Whose category ids a results file has.",
)  # fmt: skip
@click.option("--depth", type=options.EXISTING_FILE, help="Relative depth: .npy, .npz or .png.")
@click.option(
    "--space", type=options.Choice(["depth", "disparity"]), default="depth", show_default=True,
    help="depth: larger is farther; disparity: larger is nearer.",
)  # fmt: skip
@click.option(
    "--run", "runs", multiple=True, type=options.EXISTING_FOLDER,
    help="Folder of `legoworld baseline run` over this photo: masks, boxes or depth; repeat.",
)  # fmt: skip
@click.option(
    "--camera", type=options.EXISTING_FILE,
    help="A provider's camera (format plugin-camera of `legoworld list schema`) instead of --fov.",
)  # fmt: skip
@click.option(
    "--fov", type=click.FloatRange(min=1.0, max=170.0),
    help="Horizontal field of view in degrees; with it the camera's rotation is estimated.",
)  # fmt: skip
@click.option(
    "--provider", metavar="NAME",
    help="Baseline that recovers the photo's camera, and depth with it: vggt, or a folder.",
)  # fmt: skip
@click.option("--weights", help="The provider's weights: a file, a folder or a hub id.")
@click.option(
    "--python", envvar="LEGOWORLD_BASELINE_PYTHON", type=options.EXISTING_FILE,
    help="Python with the provider's requirements [default: its installed environment].",
)  # fmt: skip
@click.option("--device", default="cpu", show_default=True, help="cpu, cuda, cuda:1, mps; auto.")
@click.option(
    "--dtype", type=options.Choice(["float32", "float16", "bfloat16", "auto"]), default="float32",
    show_default=True, help="Type the provider's network computes in.",
)  # fmt: skip
@click.option(
    "--option", "chosen", multiple=True, metavar="KEY=VALUE", help="Provider option; repeat."
)
@click.option("--offline", is_flag=True, help="The provider uses local files only.")
@click.option(
    "--time-limit", type=click.FloatRange(min=0.1),
    help="Seconds the provider has to load its model, then for the photo [default: none].",
)  # fmt: skip
@sandbox_option
@click.option("-v", "--verbose", is_flag=True, help="Show the provider's output.")
@click.option("-o", "--output", required=True, type=options.FOLDER, help="Folder to write.")
def evidence(
    photo: Path,
    regions: tuple[Path, ...],
    image_id: int | None,
    task: str | None,
    depth: Path | None,
    space: Literal["depth", "disparity"],
    runs: tuple[Path, ...],
    camera: Path | None,
    fov: float | None,
    provider: str | None,
    weights: str | None,
    python: Path | None,
    device: str,
    dtype: str,
    chosen: tuple[str, ...],
    offline: bool,
    time_limit: float | None,
    sandbox: Confinement,
    verbose: bool,
    output: Path,
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
    from legoworld.api.settings import protocol_of
    from legoworld.plugin.evidence_making import Given, make_evidence
    from legoworld.workers.scratch import scratch_folder

    if sum(given is not None for given in (fov, camera, provider)) > 1:
        raise click.UsageError("--fov, --camera and --provider say the same: pass one of them")
    protocol = protocol_of(task, None)
    given = Given(
        photo=photo,
        regions=regions,
        image_id=image_id,
        vocabulary=protocol.vocabulary if protocol else None,
        depth=depth,
        depth_space=space,
        hfov_deg=fov,
        runs=runs,
        camera=camera,
    )
    with scratch_folder("legoworld-provider-") as scratch:
        if provider is not None:
            asked = _request(
                provider, weights, python, device, dtype, chosen, offline, time_limit, sandbox
            )
            given = replace(given, provided=_ask(asked, photo, scratch, verbose=verbose))
        else:
            options.refuse_given(_OF_PROVIDER, "needs a --provider")
        made = make_evidence(given, output)
    source = made.camera.rotation_source
    told = f"rotation from {source}" if source else f"unknown: {made.camera.unknown}"
    click.echo(f"regions  {len(made.regions)}")
    click.echo(f"depth    {made.depth.source if made.depth else 'none'}")
    click.echo(f"camera   {told}")
    click.echo(f"evidence {output}")
    return 0


def _request(
    name: str,
    weights: str | None,
    python: Path | None,
    device: str,
    dtype: str,
    chosen: Sequence[str],
    offline: bool,
    time_limit_s: float | None,
    sandbox: Confinement,
) -> ProviderRequest:
    from legoworld.baselines.accelerators import chosen_device, chosen_dtype
    from legoworld.baselines.cards import chosen_options, load_baseline
    from legoworld.baselines.confinement import confined
    from legoworld.baselines.environments import chosen_python
    from legoworld.baselines.photo_provider import ProviderRequest, refuse_without_camera

    card = load_baseline(name)
    refuse_without_camera(card)
    if weights is None:
        raise click.UsageError(f"--provider {name} needs --weights: a file, a folder or a hub id")
    with_python = chosen_python(card, python)
    on = chosen_device(device, with_python)
    return ProviderRequest(
        card=card,
        python=with_python,
        weights=weights,
        device=on,
        dtype=chosen_dtype(dtype, on, card),
        options=chosen_options(card, chosen),
        offline=offline,
        time_limit_s=time_limit_s,
        confined=confined(card, weights, sandbox, offline=offline),
    )


def _ask(request: ProviderRequest, photo: Path, scratch: Path, *, verbose: bool) -> Provided:
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
