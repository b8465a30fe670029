"""One JSON request in, one JSON line per image out: the child's side of `legoworld baseline run`.

The request is the first line of standard input: {"schema_version": 1, "task", "images",
"categories", "label_map", "weights", "device", "dtype", "batch_size", "offline", "options",
"prompts", "output"}. Its second line, {"begin": true}, comes once the provenance was read and
taken; no image is answered before it. Standard input then stays open for as long as legoworld
lives; when it is closed, the process ends, so that a killed legoworld leaves no model behind.

Files go below "output" alone, the one folder that can be written to besides HOME and TMPDIR.

Lines, in this order:
{"provenance": {...}, "environment": {...}}                       once, when the model is loaded
{"working_on": [image ids]}                                       before each image or batch
{"image_id", "predictions": [...], "counts": {...}}               a result of boxes or masks
{"image_id", "depth": {"file", "sha256", "size_wh", "space", "unit"}}    a depth result
{"image_id", "failed": "one line"}                                this image has none
{"done": true}                                                    at the end
{"refused": {"message", "found", "expected", "next_step"}}        instead of them all; exit code 2
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import platform
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NoReturn, TextIO, TypeVar

Model = TypeVar("Model")
Request = dict[str, Any]
"""The request; its "images" are what is still to do, its "label_map" goes to `match_labels`."""
ImageRecord = dict[str, Any]
"""{"image_id", "file_name", "path", "width", "height", "batch"}."""
Result = dict[str, Any]
"""{"predictions": [...], "counts": {...}}, or `write_depth`'s, or {"failed": "one line"}."""

REFUSED_EXIT_CODE = 2
_ONE_LINE = 400


class Refused(Exception):  # noqa: N818  it is what happened, as legoworld words it
    """Nothing can be run as asked: a wrong checkpoint, labels that do not match, a bad option."""

    def __init__(
        self, message: str, *, found: str = "", expected: str = "", next_step: str = ""
    ) -> None:
        super().__init__(message)
        self.reason = {
            "message": message,
            "found": found,
            "expected": expected,
            "next_step": next_step,
        }


def serve(
    load: Callable[[Request], tuple[Model, dict[str, Any]]],
    predict: Callable[[Model, ImageRecord], Result] | None = None,
    *,
    predict_batch: Callable[[Model, Sequence[ImageRecord]], Sequence[Result]] | None = None,
) -> NoReturn:
    """Answer legoworld's request and end the process.

    load: the request to (model, provenance). Import torch in there: until `serve` runs, what a
        library prints goes to the wrong place. Provenance is everything the numbers depend on and
        nothing else (no times, no paths): a run is only resumed under an equal one. Raise
        `Refused` for anything that would make every image wrong.
    predict: one image to its result. An exception is this image's failure, never the run's. A
        request for batches is refused: a run that says it was batched and was not is no record.
    predict_batch: instead of predict, for "batch_size" images at once; one result each, in order,
        {"failed": why} for one that cannot be used. Which images share a batch never changes when
        a run is resumed. When a batch raises, its images fail together.
    """
    if (predict is None) == (predict_batch is None):
        raise TypeError("serve takes predict or predict_batch")
    channel = _channel()
    begun = threading.Event()
    request = _read_request(begun)
    _listen_to_the_parent(begun)
    try:
        if predict is not None:
            _refuse_batches(request)
        model, provenance = load(request)
    except Refused as refusal:
        _say(channel, {"refused": refusal.reason})
        _end(REFUSED_EXIT_CODE)
    _say(channel, {"provenance": provenance, "environment": _environment()})
    begun.wait()
    for batch in _batches(request["images"], alone=predict is not None):
        _say(channel, {"working_on": [image["image_id"] for image in batch]})
        results = _results(model, batch, predict, predict_batch)
        for image, result in zip(batch, results, strict=True):
            _answer(channel, image["image_id"], result)
    _say(channel, {"done": True})
    _end(0)


def _refuse_batches(request: Request) -> None:
    if request["batch_size"] != 1:
        raise Refused(
            "this baseline runs one photo at a time",
            found=f"batch size {request['batch_size']}",
            expected="1: photos of a larger batch are padded, which changes the numbers",
            next_step="leave --batch-size away",
        )


def _results(
    model: Any,
    batch: Sequence[ImageRecord],
    predict: Callable[[Any, ImageRecord], Result] | None,
    predict_batch: Callable[[Any, Sequence[ImageRecord]], Sequence[Result]] | None,
) -> Sequence[Result]:
    try:
        if predict is not None:
            return [predict(model, batch[0])]
        assert predict_batch is not None
        results = list(predict_batch(model, batch))
        if len(results) != len(batch):
            raise ValueError(f"{len(results)} results of a batch of {len(batch)} images")
    except Exception as error:  # noqa: BLE001  a model's code may raise anything: it is on record
        traceback.print_exc(file=sys.stderr)
        return [{"failed": failure_line(error)}] * len(batch)
    return results


def failure_line(error: BaseException) -> str:
    """An exception as the one line a per-image row carries."""
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return text if len(text) <= _ONE_LINE else text[: _ONE_LINE - 1] + "…"


def _batches(images: Sequence[ImageRecord], *, alone: bool) -> Iterator[list[ImageRecord]]:
    """Images one by one, or those with the same "batch" number together."""
    if alone:
        yield from ([image] for image in images)
        return
    for _, group in itertools.groupby(images, key=lambda image: image["batch"]):
        yield list(group)


def _channel() -> TextIO:
    """A stream to legoworld of our own; whatever prints to standard output now prints to the log.

    Native code that writes to file descriptor 1 is caught, too.
    """
    sys.stdout.flush()
    own = os.dup(1)
    os.dup2(2, 1)
    stream = os.fdopen(own, "w", encoding="utf-8", newline="\n")
    stream.write("\n")  # ends a line that an import may have begun
    stream.flush()
    return stream


def _answer(channel: TextIO, image_id: int, result: Result) -> None:
    """One image's line; a result that is no JSON (NaN, a tensor) is that image's failure."""
    try:
        _say(channel, {"image_id": image_id, **result})
    except (TypeError, ValueError, RecursionError) as error:
        _say(channel, {"image_id": image_id, "failed": failure_line(error)})


def _say(channel: TextIO, line: dict[str, Any]) -> None:
    """One line, whole. ValueError for NaN and infinity, which are no results."""
    text = json.dumps(line, ensure_ascii=False, allow_nan=False)
    channel.write(text + "\n")
    channel.flush()


def _read_request(begun: threading.Event) -> Request:
    """The first line; `begun` is set where more than that was read.

    Not by sys.stdin: Python ends in an abort while a thread waits in it.
    """
    text = b""
    while b"\n" not in text and (read := os.read(0, 1 << 16)):
        text += read
    line, _, more = text.partition(b"\n")
    if more:
        begun.set()
    request: Request = json.loads(line)
    if request.get("schema_version") != 1:
        raise SystemExit(f"request of schema_version {request.get('schema_version')!r}, not 1")
    return request


def _listen_to_the_parent(begun: threading.Event) -> None:
    """Hear its second line; end when it has ended."""

    def listen() -> None:
        with contextlib.suppress(OSError, ValueError):
            while os.read(0, 1024):
                begun.set()
        os._exit(1)

    threading.Thread(target=listen, daemon=True, name="listen-to-the-parent").start()


def _end(code: int) -> NoReturn:
    """Leave at once: what a library does at exit (or fails to) changes nothing that was said."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _environment() -> dict[str, Any]:
    """For the record only, never compared: the machine the numbers were made on."""
    found: dict[str, Any] = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "system": platform.system(),
    }
    torch: Any = sys.modules.get("torch")
    if torch is not None:
        found["torch"] = torch.__version__
        found["cpu_threads"] = torch.get_num_threads()
        if torch.cuda.is_available():
            found["gpu"] = torch.cuda.get_device_name()
    return found
