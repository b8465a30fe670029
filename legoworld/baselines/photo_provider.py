"""One photo and the baseline that recovers its camera: asked once, for `plugin evidence`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from typing import Final

from legoworld.baselines.answers import Unreadable
from legoworld.baselines.cards import BaselineCard, baseline_cards
from legoworld.baselines.child import BaselineProcess, TooSlowError
from legoworld.baselines.conversation import compute_deadline, first_message
from legoworld.baselines.request import ChosenModel, weights_name, weights_place
from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import LegoWorldError, UsageError
from legoworld.files import sha256_of_file
from legoworld.plugin.evidence_depth import GivenDepth
from legoworld.plugin.make_evidence import BaselineEvidence
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.readouts.pictures import read_photo
from legoworld.records.baseline_messages import ChildRequest, DepthSaid, Message, RequestedImage
from legoworld.records.plugin_evidence import DepthSpace, ProviderCamera, ProviderRecord

#: What the process is asked for, in place of a task.
CAMERA_TASK: Final = "camera"
_IMAGE_ID: Final = 1
_SPACES: Final[Mapping[str, DepthSpace]] = {"depth": "depth", "disparity": "disparity"}


class ProviderFailedError(LegoWorldError):
    """A provider was asked about a photo and has no answer, or none that can be used."""

    code = "provider_failed"


def refuse_without_camera(card: BaselineCard) -> None:
    """UsageError for a baseline that recovers no camera."""
    if not card.about.camera:
        raise UsageError(
            f"the baseline {card.name} recovers no camera",
            found=f"--provider {card.name}",
            expected=" or ".join(c.name for c in baseline_cards() if c.about.camera),
            next_step="take its depth or regions from a run: --run RUN",
        )


def ask_provider(
    request: ChosenModel, photo: Path, output: Path, log: Callable[[str], None]
) -> BaselineEvidence:
    """The photo's camera and, where the baseline gives one, its relative depth.

    output: an existing folder for the depth's file. Raises BaselineRefusedError and
    BaselineFailedError where nothing can be run, ProviderFailedError where this photo has no
    answer.
    """
    height, width = read_photo(photo).shape[:2]
    image = RequestedImage(
        image_id=_IMAGE_ID, file_name=photo.name, path=str(photo.resolve()),
        width=width, height=height, batch=0,
    )  # fmt: skip
    child = _child_request(request, image, output)
    variables = request.card.about.variables
    with BaselineProcess(
        request.card, request.python, child, log,
        output=output, confinement=request.confinement, variables=variables,
    ) as process:  # fmt: skip
        hello = first_message(process, request.card.name, request.time_limit_s, "--time-limit")
        process.begin()
        answer = _answer(process, request)
        if answer.depth is not None:
            process.take(_depth_name(photo))
    if answer.camera is None:
        raise _provider_error(request, "no camera in its answer", "a camera")
    depth = None if answer.depth is None else _depth(request, answer.depth, photo, output)
    camera = ProviderCamera(
        schema_version=1,
        source=request.source,
        photo_sha256=sha256_of_file(photo),
        width=answer.camera.width,
        height=answer.camera.height,
        fx=answer.camera.fx,
        fy=answer.camera.fy,
        cx=answer.camera.cx,
        cy=answer.camera.cy,
    )
    record = _record(request, hello, answer.counts or {})
    return BaselineEvidence(record=record, camera=camera, depth=depth)


def _answer(process: BaselineProcess, request: ChosenModel) -> Message:
    """The line about the photo; what comes before it is skipped."""
    deadline = compute_deadline(request.time_limit_s)
    while True:
        try:
            message = process.next_message(deadline)
            late = deadline is not None and time.monotonic() > deadline
            if late and message is not None and message.image_id != _IMAGE_ID:
                raise TooSlowError
        except TooSlowError as error:
            words = f"no answer after {request.time_limit_s:g} s; {process.last_words()}"
            raise _provider_error(request, words, "an answer within --time-limit") from error
        if message is None:
            raise _provider_error(request, process.how_it_ended(), "an answer", _MEMORY)
        if isinstance(message, Unreadable):
            raise _provider_error(request, message.reason, "one line of JSON")
        if message.failed is not None:
            raise _provider_error(request, message.failed, "a camera")
        if message.image_id == _IMAGE_ID:
            return message
        if message.done:
            raise _provider_error(request, "the end without an answer", "a camera")


_MEMORY: Final = "a process that is killed by SIGKILL usually had no memory left; -v shows its log"


def _provider_error(
    request: ChosenModel, found: str, expected: str, next_step: str = ""
) -> ProviderFailedError:
    return ProviderFailedError(
        f"{request.card.name} has no camera for the photo",
        found=found,
        expected=expected,
        next_step=next_step or "pass --fov, or --camera with a file of another provider",
    )


def _depth(request: ChosenModel, said: DepthSaid, photo: Path, output: Path) -> GivenDepth:
    path = output / _depth_name(photo)
    if not path.is_file() or sha256_of_file(path) != said.sha256:
        raise _provider_error(
            request,
            f"{path.name} is absent or not the one it spoke of",
            "depth of the sha256 it gave",
        )
    if said.space not in _SPACES:
        raise _provider_error(request, f"depth of space {said.space}", " or ".join(_SPACES))
    return GivenDepth(path=path, space=_SPACES[said.space], source=request.source, of_photo=True)


def _depth_name(photo: Path) -> str:
    return DEPTH_FILE.path(PurePosixPath(photo.name).with_suffix("").as_posix())


def _child_request(request: ChosenModel, image: RequestedImage, output: Path) -> ChildRequest:
    return ChildRequest(
        schema_version=SCHEMA_VERSION,
        task=CAMERA_TASK,
        images=(image,),
        categories=(),
        label_map={},
        weights=weights_place(request.weights),
        device=request.device,
        dtype=request.dtype,
        batch_size=1,
        offline=request.offline,
        options=dict(request.options),
        prompts=None,
        output=str(output.resolve()),
    )


def _record(request: ChosenModel, hello: Message, counts: Mapping[str, int]) -> ProviderRecord:
    return ProviderRecord(
        name=request.card.name,
        version=request.card.about.version,
        card_sha256=request.card.sha256,
        code_sha256=request.card.code_sha256(),
        weights=weights_name(request.weights),
        device=request.device.partition(":")[0],
        dtype=request.dtype,
        options=dict(request.options),
        provenance=hello.provenance or {},
        environment=hello.environment,
        counts=dict(counts),
    )
