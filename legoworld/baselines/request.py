"""The request for a baseline's run: the model as it is run, and the run's configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from msgspec.structs import replace

from legoworld.baselines.accelerators import chosen_device, chosen_dtype
from legoworld.baselines.cards import BaselineCard, chosen_options
from legoworld.baselines.confinement import BaselineConfinement, confine_baseline
from legoworld.baselines.environments import chosen_python
from legoworld.baselines.labels import LabelMap
from legoworld.baselines.records import AnswerRules
from legoworld.baselines.truth_prompts import TruthPrompts, request_prompts
from legoworld.conventions import SCHEMA_VERSION
from legoworld.files import canonical_json, sha256_of_text
from legoworld.readouts.family import Protocol
from legoworld.records.base import UNSET
from legoworld.records.baseline_messages import (
    ChildRequest,
    RequestedCategory,
    RequestedImage,
)
from legoworld.records.cards import OptionValue
from legoworld.records.run_file import Configuration
from legoworld.running.readout_run import common_configuration
from legoworld.tracks.track import Track, TrackImage
from legoworld.workers.protections import Confinement


class ModelOptions(TypedDict, total=False):
    """What a caller may choose of how a baseline's process is run.

    python: the Python with its requirements, None for the installed environment. device, dtype:
    such as "cuda:1" and "float16", "auto" for what the machine has. options: "KEY=VALUE" texts of
    the card. offline: local files only. time_limit_s: from one answer to the next, None for none.
    sandbox: as in `execute`.
    """

    python: str | Path | None
    device: str
    dtype: str
    options: Sequence[str]
    offline: bool
    time_limit_s: float | None
    sandbox: Confinement


@dataclass(frozen=True, kw_only=True)
class ChosenModel:
    """How a baseline's process is run. device: such as "cpu" or "cuda:1".

    time_limit_s: from one answer to the next; of a provider for its model, and again for the photo.
    """

    card: BaselineCard
    weights: str
    python: Path
    device: str
    dtype: str
    options: Mapping[str, OptionValue | None]
    offline: bool
    time_limit_s: float | None
    confinement: BaselineConfinement

    @property
    def source(self) -> str:
        """As evidence names it: "vggt 1.0.0"."""
        return f"{self.card.name} {self.card.about.version}"


def choose_model(
    card: BaselineCard, weights: str, options: ModelOptions, inputs: Sequence[str | Path] = ()
) -> ChosenModel:
    """How the baseline of a card is run. inputs: what it may read besides its own files."""
    python, offline = options.get("python"), options.get("offline", False)
    used = chosen_python(card, None if python is None else Path(python))
    device = chosen_device(options.get("device", "cpu"), used)
    sandbox, paths = options.get("sandbox", "auto"), [Path(path) for path in inputs]
    return ChosenModel(
        card=card,
        weights=weights,
        python=used,
        device=device,
        dtype=chosen_dtype(options.get("dtype", "float32"), device, card),
        options=chosen_options(card, options.get("options", ())),
        offline=offline,
        time_limit_s=options.get("time_limit_s"),
        confinement=confine_baseline(card, weights, sandbox, offline=offline, inputs=paths),
    )


@dataclass(frozen=True, kw_only=True)
class BaselineRequest(ChosenModel):
    """All parameters of a baseline's run.

    python, offline, overwrite, confinement and time limits never change its results.
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
        prompts=request_prompts(request.prompts),
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
