"""The dialogue with a baseline's process, which may refuse, crash, hang or stay silent."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from legoworld.baselines.answers import Unreadable
from legoworld.baselines.child import BaselineFailedError, BaselineProcess, TooSlowError
from legoworld.baselines.records import (
    AnswerInvalidError,
    ImageCrashedError,
    ImageTimeoutError,
    PhotoMissingError,
    answered_record,
)
from legoworld.baselines.request import BaselineRequest, child_request
from legoworld.errors import LegoWorldError, UsageError
from legoworld.files import sha256_of_file
from legoworld.pluralize import plural
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.baseline_messages import Message
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.running.image_record import failed_record
from legoworld.tracks.track import TrackImage

Photos = Mapping[int, Path]
Provenance = dict[str, Any]
"""What a model says of itself, as run.json keeps it."""

#: Attempts per image: after a crash it is retried once in a new process, in case of other causes.
_TRIES = 2


class BaselineRefusedError(UsageError):
    """The baseline refuses the request."""

    code = "baseline_refused"


def first_message(
    process: BaselineProcess,
    name: str,
    time_limit_s: float | None,
    option: str = "--load-time-limit",
) -> Message:
    """What a process says of its model once it is loaded; its provenance is there.

    BaselineRefusedError with the baseline's own reason; BaselineFailedError where it ends instead,
    or has not loaded it within the time limit, which is an option's.
    """
    try:
        message = process.next_message(compute_deadline(time_limit_s))
    except TooSlowError as error:
        raise BaselineFailedError(
            f"the baseline {name} did not load its model in time",
            found=f"nothing after {time_limit_s:g} s; {process.last_words()}",
            expected="a loaded model within the time limit",
            next_step=f"raise {option}",
        ) from error
    if message is None:
        raise BaselineFailedError(
            f"the baseline {name} ended before it was ready",
            found=process.how_it_ended(),
            expected="a loaded model",
            next_step="`legoworld doctor` says what its environment lacks; -v shows its log",
        )
    if isinstance(message, Unreadable):
        raise BaselineFailedError(
            f"the first line of the baseline {name} cannot be used",
            found=message.reason,
            expected='{"provenance": {...}}',
        )
    if message.refused is not None:
        raise BaselineRefusedError(
            f"{name}: {message.refused.message}",
            found=message.refused.found or "",
            expected=message.refused.expected or "",
            next_step=message.refused.next_step or "",
        )
    if message.provenance is None:
        raise BaselineFailedError(
            f"the baseline {name} does not report what it runs",
            found="a first line without a provenance",
            expected='{"provenance": {...}, "environment": {...}}',
        )
    return message


def compute_deadline(time_limit_s: float | None) -> float | None:
    """When a time limit that begins now is over, in time.monotonic() seconds."""
    return None if time_limit_s is None else time.monotonic() + time_limit_s


class Conversation:
    """Requests images until each has a record.

    photos: the photo of each image; batches: the batch number of each image; begin: called with
    each process's provenance before the first request, and may refuse it; log: called with
    verbose output; notice: called with messages that are always shown.
    """

    def __init__(
        self,
        request: BaselineRequest,
        photos: Photos,
        batches: Mapping[int, int],
        begin: Callable[[Provenance], None],
        log: Callable[[str], None],
        notice: Callable[[str], None],
    ) -> None:
        self._request = request
        self._photos = photos
        self._batches = batches
        self._begin = begin
        self._log = log
        self._notice = notice
        self._gpu_notice_given = False
        self._pending: dict[int, TrackImage] = {}
        self._deaths: Counter[int] = Counter()
        self._environment: dict[str, Any] = {}

    def records(self, images: list[TrackImage], todo: list[TrackImage]) -> Iterator[ImageRecord]:
        """Records of the `todo` images, as they are made. images: all of the run, in order.

        Images in the same batch as a pending one are predicted again, so that a batch always has
        the same images; only pending ones are recorded. A process is started even if nothing is
        pending, because only it can confirm that the weights are still those of the run.
        """
        self._pending = {image.id: image for image in todo}
        begun = False
        while self._pending or not begun:
            begun = True
            wanted = {self._batches[image_id] for image_id in self._pending}
            sent = [
                (image, self._photos[image.id], self._batches[image.id])
                for image in images
                if image.id in self._photos and self._batches[image.id] in wanted
            ]
            request = child_request(self._request, sent)
            with BaselineProcess(
                self._request.card,
                self._request.python,
                request,
                self._log,
                output=self._request.run,
                confinement=self._request.confinement,
                variables=self._request.variables,
            ) as process:
                yield from self._listen(process, {image.id: image for image, _, _ in sent})

    def _listen(
        self, process: BaselineProcess, sent: Mapping[int, TrackImage]
    ) -> Iterator[ImageRecord]:
        """One process from its first message to its end. sent: the images it was asked for."""
        self._hello(process)
        working: list[int] = []
        answered: set[int] = set()
        deadline = compute_deadline(self._request.time_limit_s)
        while True:
            try:
                message = process.next_message(deadline)
                if message is not None and message.image_id in sent:
                    deadline = None  # until its record is kept
                elif deadline is not None and time.monotonic() > deadline:
                    raise TooSlowError  # it sends lines, and no answer
            except TooSlowError:
                process.close()
                yield from self._fail(self._suspects(working), self._too_slow(process))
                return
            if message is None:
                yield from self._record_crash(process, working)
                return
            if message.image_id is not None:
                yield from self._receive_answer(process, message.image_id, message, sent, answered)
                deadline = compute_deadline(self._request.time_limit_s)
            elif isinstance(message, Unreadable):
                yield from self._fail(working, self._unusable(message))
            elif message.done:
                silent = AnswerInvalidError(
                    "the baseline gave no answer for the image", expected="one line per image"
                )
                yield from self._fail(list(self._pending), silent)
                return
            elif message.working_on is not None:
                working = self._waited_for(message.working_on)
            working = [i for i in working if i in self._pending]

    def _receive_answer(
        self,
        process: BaselineProcess,
        image_id: int,
        answer: Message | Unreadable,
        sent: Mapping[int, TrackImage],
        answered: set[int],
    ) -> Iterator[ImageRecord]:
        """The record of an answer.

        One that was not asked for ends the run; a second one of an image fails it, because nothing
        tells which of the two is right.
        """
        if image_id not in sent:
            raise BaselineFailedError(
                f"the baseline {self._request.card.name} answered for image {image_id}",
                found="an image that it was not asked for",
                expected=f"the image_id of one of {plural(len(sent), 'image', 'images')}, such as "
                f"{min(sent)}",
                next_step="answer with the image_id of the request",
            )
        image = sent[image_id]
        if image_id in answered:
            twice = AnswerInvalidError(
                "the baseline answered twice for the image",
                found=f"two answers of image {image_id}, {image.file_name}",
                expected="one line per image",
                next_step="correct the baseline's program: neither answer is kept",
            )
            yield failed_record(image, twice)
        answered.add(image_id)
        if image_id in self._pending:
            del self._pending[image_id]
            if isinstance(answer, Unreadable):
                yield failed_record(image, self._unusable(answer))
            else:
                yield self._record_answer(process, image, answer)

    def _hello(self, process: BaselineProcess) -> None:
        limit = self._request.load_time_limit_s
        message = first_message(process, self._request.card.name, limit)
        environment = message.environment
        self._environment = environment
        if self._request.device == "cpu" and "gpu" in environment and not self._gpu_notice_given:
            self._gpu_notice_given = True
            self._notice(
                f"running on the CPU although torch sees a GPU ({environment['gpu']}): pass "
                "--device cuda or --device auto"
            )
        self._begin(message.provenance or {})
        process.begin()

    def _waited_for(self, image_ids: Sequence[int]) -> list[int]:
        """The ids that a process noted and that still have no record."""
        return list(dict.fromkeys(i for i in image_ids if i in self._pending))

    def _record_answer(
        self, process: BaselineProcess, image: TrackImage, message: Message
    ) -> ImageRecord:
        path = self._photos[image.id]
        try:
            photo_sha256 = sha256_of_file(path)
        except OSError as error:
            gone = PhotoMissingError(
                "the photo went away while it was predicted",
                found=f"{path.name}: {error.strerror}",
                expected="photos that stay for as long as the run",
            )
            return failed_record(image, gone)
        try:
            if message.depth is not None and not process.take(DEPTH_FILE.path(image.scene)):
                raise AnswerInvalidError(
                    "the depth file was not written", expected=DEPTH_FILE.path(image.scene)
                )
        except LegoWorldError as error:
            return failed_record(image, error)
        source = ImageSource(photo_sha256=photo_sha256, environment=self._environment)
        return answered_record(image, message, self._request.rules, source)

    def _unusable(self, line: Unreadable) -> AnswerInvalidError:
        self._log(f"legoworld: a line of the baseline cannot be used: {line.reason}")
        return AnswerInvalidError(
            "the baseline's answer cannot be used", found=line.reason, expected="one line of JSON"
        )

    def _suspects(self, working: list[int]) -> list[int]:
        """The images it worked on; between images the next one is as good a suspect as any."""
        return working or [*self._pending][:1]

    def _record_crash(self, process: BaselineProcess, working: list[int]) -> Iterator[ImageRecord]:
        """Record a crash: images that crashed before fail, the others are retried."""
        ended = process.how_it_ended()
        if not self._pending:  # it had answered for all of them
            return
        working = self._suspects(working)
        names = ", ".join(self._pending[i].file_name for i in working)
        self._log(f"legoworld: the baseline's process ended ({ended}) while it had {names}")
        self._deaths.update(working)
        error = ImageCrashedError(
            f"the baseline's process died {_TRIES} times while it had the image",
            found=ended,
            expected="an answer",
            next_step="-v shows its log; a smaller --batch-size needs less memory",
        )
        yield from self._fail([i for i in working if self._deaths[i] >= _TRIES], error)

    def _fail(self, image_ids: list[int], error: LegoWorldError) -> Iterator[ImageRecord]:
        for image_id in image_ids:
            yield failed_record(self._pending.pop(image_id), error)

    def _too_slow(self, process: BaselineProcess) -> ImageTimeoutError:
        return ImageTimeoutError(
            "the baseline did not finish the image",
            found=f"no answer after {self._request.time_limit_s:g} s; {process.last_words()}",
            expected="an answer within the time limit",
            next_step="raise --time-limit",
        )
