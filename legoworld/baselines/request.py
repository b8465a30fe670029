"""The request for a baseline's run, and its configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from legoworld.baselines.chosen_model import ChosenModel
from legoworld.baselines.labels import LabelMap
from legoworld.baselines.records import AnswerRules
from legoworld.baselines.truth_prompts import TruthPrompts, prompts_of_request
from legoworld.conventions import SCHEMA_VERSION
from legoworld.files import canonical_json, sha256_of_text
from legoworld.readouts.protocol import Protocol
from legoworld.records.base import UNSET
from legoworld.records.baseline_messages import (
    ChildRequest,
    RequestedCategory,
    RequestedImage,
)
from legoworld.records.run_file import Configuration
from legoworld.running.readout_run import common_configuration
from legoworld.tracks.track import Track, TrackImage


@dataclass(frozen=True, kw_only=True)
class BaselineRequest(ChosenModel):
    """All parameters of a baseline's run.

    python, offline, overwrite, confined and time limits never change its results.
    load_time_limit_s: for the model, None for no limit; pass_variables: further variables of the
    caller's environment besides those the card names.
    """

    protocol: Protocol
    track: Track
    photos: Path
    run: Path
    batch_size: int
    labels: LabelMap
    prompts: TruthPrompts | None
    overwrite: bool
    limit: int | None
    image_ids: tuple[int, ...]
    load_time_limit_s: float | None
    pass_variables: tuple[str, ...] = ()

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the caller's variables that are passed to the baseline's process."""
        return (*self.card.about.variables, *self.pass_variables)

    @property
    def rules(self) -> AnswerRules:
        """The rules for checking answers."""
        protocol = self.protocol
        return AnswerRules(run=self.run, task=protocol.task.name, vocabulary=protocol.vocabulary)


def baseline_configuration(
    protocol: Protocol, track: Track, images: Sequence[TrackImage], *, partial: bool
) -> Configuration:
    """The configuration of any baseline's run, imported or not."""
    return replace(
        common_configuration(protocol, track, images),
        kind="baseline",
        partial=partial,
        prediction_order="given" if protocol.vocabulary else UNSET,
    )


def build_configuration(request: BaselineRequest, images: Sequence[TrackImage]) -> Configuration:
    """Everything a run's results depend on, except the photos and the model's provenance.

    The hashes of the weights are in the provenance that the process reports after loading them.
    """
    partial = request.limit is not None or bool(request.image_ids)
    return replace(
        baseline_configuration(request.protocol, request.track, images, partial=partial),
        baseline=request.card.name,
        baseline_version=request.card.about.version,
        baseline_card_sha256=request.card.sha256,
        code_sha256=request.card.code_sha256(),
        weights=weights_name(request.weights),
        device=request.device.partition(":")[0],
        dtype=request.dtype,
        batch_size=request.batch_size,
        options=dict(request.options),
        label_map_sha256=sha256_of_text(canonical_json(request.labels)),
        used_truth=request.prompts.used if request.prompts else None,
    )


def weights_name(weights: str) -> str:
    """What records call the weights: the file's or folder's own name, or the hub id."""
    return Path(weights).name if Path(weights).exists() else weights


def weights_place(weights: str) -> str:
    """Where a process finds the weights: an absolute path, or the hub id."""
    return str(Path(weights).resolve()) if Path(weights).exists() else weights


def child_request(
    request: BaselineRequest, images: Sequence[tuple[TrackImage, Path, int]]
) -> ChildRequest:
    """The single request sent to a process. images: with photo path and batch number."""
    vocabulary = request.protocol.vocabulary
    return ChildRequest(
        schema_version=SCHEMA_VERSION,
        task=request.protocol.task.name,
        images=tuple(_request_image(*placed) for placed in images),
        categories=tuple(
            RequestedCategory(id=c.id, name=c.name, synonyms=c.synonyms)
            for c in (vocabulary.categories if vocabulary else ())
        ),
        label_map=request.labels,
        weights=weights_place(request.weights),
        device=request.device,
        dtype=request.dtype,
        batch_size=request.batch_size,
        offline=request.offline,
        options=dict(request.options),
        prompts=prompts_of_request(request.prompts),
        output=str(request.run.resolve()),
    )


def _request_image(image: TrackImage, path: Path, batch: int) -> RequestedImage:
    assert image.size_wh is not None
    return RequestedImage(
        image_id=image.id,
        file_name=image.file_name,
        path=str(path.resolve()),
        width=image.size_wh[0],
        height=image.size_wh[1],
        batch=batch,
    )
