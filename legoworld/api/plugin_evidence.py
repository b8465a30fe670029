"""`plugin_evidence`: what a photo says about its scene, without ground truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

from legoworld.api.arguments import check_arguments, optional_path
from legoworld.api.baselines import warn_unconfined
from legoworld.api.listener import SILENT, Listener
from legoworld.api.settings import load_protocol
from legoworld.baselines.cards import load_baseline
from legoworld.baselines.photo_provider import ask_provider, refuse_without_camera
from legoworld.baselines.request import ChosenModel, ModelOptions, choose_model
from legoworld.errors import UsageError
from legoworld.plugin.make_evidence import BaselineEvidence, UserEvidence, make_evidence
from legoworld.records.plugin_evidence import DepthSpace, EvidenceFile
from legoworld.workers.scratch import scratch_folder


@check_arguments
def plugin_evidence(
    output: str | Path,
    *,
    photo: str | Path,
    regions: Sequence[str | Path] = (),
    photo_id: int | None = None,
    task: str | None = None,
    depth: str | Path | None = None,
    depth_space: DepthSpace = "depth",
    runs: Sequence[str | Path] = (),
    camera: str | Path | None = None,
    hfov_deg: float | None = None,
    provider: str | None = None,
    weights: str | None = None,
    listener: Listener = SILENT,
    **model: Unpack[ModelOptions],
) -> EvidenceFile:
    """Gather regions, relative depth and the camera of a photo into a folder; its evidence.json.

    regions: files of outlines, or of COCO or LVIS results, whose photo is `photo_id` and whose
    category ids are those of `task`. depth: relative depth as .npy, .npz or .png. runs: folders of
    baselines that saw the photo. The camera is a provider's file, or a horizontal field of view in
    degrees, or recovered by the baseline `provider`, which is run with `weights` and `model`.
    UsageError for two sources of the camera, and for a provider without weights.
    """
    if sum(one is not None for one in (hfov_deg, camera, provider)) > 1:
        raise UsageError("--fov, --camera and --provider exclude each other: pass one of them")
    vocabulary = None if task is None else load_protocol(task, None)
    with scratch_folder("legoworld-provider-") as scratch:
        provided = None
        if provider is not None:
            card = load_baseline(provider)
            refuse_without_camera(card)
            if weights is None:
                raise UsageError(
                    f"--provider {provider} needs --weights: a file, a folder or a hub id"
                )
            provided = _ask(choose_model(card, weights, model), Path(photo), scratch, listener)
        return make_evidence(
            UserEvidence(
                photo=Path(photo),
                regions=[Path(path) for path in regions],
                image_id=photo_id,
                vocabulary=vocabulary.vocabulary if vocabulary else None,
                depth=optional_path(depth),
                depth_space=depth_space,
                hfov_deg=hfov_deg,
                runs=[Path(run) for run in runs],
                camera=optional_path(camera),
                baseline=provided,
            ),
            Path(output),
        )


def _ask(request: ChosenModel, photo: Path, scratch: Path, listener: Listener) -> BaselineEvidence:
    """The provider's answer, and a notice of what it says of the camera."""
    warn_unconfined(request.confinement, listener)
    provided = ask_provider(request, photo, scratch, listener.log)
    seen = provided.camera
    degrees = [
        2 * math.degrees(math.atan(side / 2 / focal))
        for side, focal in ((seen.width, seen.fx), (seen.height, seen.fy))
    ]
    listener.notice(
        f"provider {seen.source}: fx {seen.fx:.2f}, fy {seen.fy:.2f}, cx {seen.cx:.2f}, "
        f"cy {seen.cy:.2f} px of {seen.width}x{seen.height}; "
        f"{degrees[0]:.2f} x {degrees[1]:.2f} degrees"
    )
    return provided
