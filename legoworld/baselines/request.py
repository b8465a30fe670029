"""The request for a baseline's run, and its configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from legoworld.baselines.cards import BaselineCard
from legoworld.baselines.confinement import BaselineConfinement
from legoworld.baselines.labels import LabelMap
from legoworld.baselines.records import AnswerRules
from legoworld.baselines.truth_prompts import TruthPrompts, prompts_of_request
from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import UsageError
from legoworld.files import canonical_json, sha256_of_text
from legoworld.readouts.protocol import Protocol
from legoworld.records.base import UNSET
from legoworld.records.baseline_messages import (
    ChildRequest,
    RequestedCategory,
    RequestedImage,
)
from legoworld.records.cards import OptionValue
from legoworld.records.run_file import Configuration
from legoworld.tracks.track import Track, TrackImage
from legoworld.version import __version__


@dataclass(frozen=True, kw_only=True)
class BaselineRequest:
    """All parameters of a baseline's run.

    python, offline, overwrite, confined and time limits never change its results. device: such as
    "cpu" or "cuda:1"; load_time_limit_s: for the model, None for no limit; time_limit_s: from one
    answer to the next; pass_variables: further variables of the caller's environment besides those
    the card names.
    """

    card: BaselineCard
    protocol: Protocol
    track: Track
    photos: Path
    weights: str
    run: Path
    python: Path
    device: str
    dtype: str
    batch_size: int
    options: Mapping[str, OptionValue | None]
    labels: LabelMap
    prompts: TruthPrompts | None
    offline: bool
    overwrite: bool
    limit: int | None
    image_ids: tuple[int, ...]
    load_time_limit_s: float | None
    time_limit_s: float | None
    confined: BaselineConfinement
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


def selected_images(track: Track, image_ids: Sequence[int], limit: int | None) -> list[TrackImage]:
    """The images to attempt: all of the track's, or those selected by --image-id and --limit.

    Raises UsageError for an id that the track does not have.
    """
    images = list(track.images)
    known = {image.id for image in images}
    unknown = [i for i in image_ids if i not in known]
    if unknown:
        raise UsageError(
            "the track has no such image",
            found=f"--image-id {unknown[0]}",
            expected=f"one of {len(known)} ids, such as {min(known)}",
        )
    if image_ids:
        images = [image for image in images if image.id in image_ids]
    return images[:limit] if limit is not None else images


def common_configuration(
    protocol: Protocol, track: Track, images: Sequence[TrackImage], *, partial: bool
) -> Configuration:
    """The part of the configuration shared with a scene's run."""
    described = [[i.id, i.file_name, i.size_wh] for i in images]
    return Configuration(
        schema_version=SCHEMA_VERSION,
        kind="baseline",
        task=protocol.task.name,
        card_version=protocol.card.version,
        card_sha256=protocol.card.sha256,
        vocabulary_sha256=protocol.vocabulary.sha256 if protocol.vocabulary else None,
        track_sha256=track.sha256,
        images_sha256=sha256_of_text(canonical_json(described)),
        attempted=len(images),
        partial=partial,
        legoworld=__version__,
        prediction_order="given" if protocol.vocabulary else UNSET,
    )


def build_configuration(request: BaselineRequest, images: Sequence[TrackImage]) -> Configuration:
    """Everything a run's results depend on, except the photos and the model's provenance.

    The hashes of the weights are in the provenance that the process reports after loading them.
    """
    partial = request.limit is not None or bool(request.image_ids)
    return replace(
        common_configuration(request.protocol, request.track, images, partial=partial),
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
