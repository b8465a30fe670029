"""`legoworld bench serve`: submissions to scores, one by one, with warm workers."""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from threading import BoundedSemaphore, Lock
from typing import BinaryIO, Final, Self

from legoworld.errors import Raised, cause
from legoworld.evaluation.reconstruction.case import CaseTask, score_case
from legoworld.evaluation.reconstruction.choices import Choices
from legoworld.evaluation.reconstruction.dataset import BenchDataset
from legoworld.evaluation.reconstruction.protocol import BenchProtocol
from legoworld.readouts.protocol import protocol
from legoworld.records.base import RecordError, as_json, decode, to_record
from legoworld.records.bench_results import ServeAnswer, ServeRequest
from legoworld.records.reconstruction import EVALUATOR_ERROR, ReconstructionRow
from legoworld.records.submission import BenchRow
from legoworld.running.image import read_image
from legoworld.running.image_record import ImageOptions
from legoworld.running.submission import BenchRules
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.tracks.track import TrackImage
from legoworld.workers.scratch import ScratchFolder

_LONGEST_LINE: Final = 1 << 20


@dataclass(frozen=True, kw_only=True)
class ServeOptions:
    """Settings shared by all submissions.

    root: the folder that all submissions lie below; threads: of each worker.
    """

    root: Path
    dataset: BenchDataset
    bench: BenchProtocol
    rules: BenchRules
    diagnostics: bool
    cache: SnapshotCache | None
    limits: Limits
    threads: int


class ScoreWorker:
    """Scores submission after submission with one Blender process of its own."""

    def __init__(self, options: ServeOptions) -> None:
        self._options = options
        self._aborted = False
        self._scratch = ScratchFolder("legoworld-serve-")
        self._blender = BlenderProcess(options.limits)

    def answer(self, line: bytes) -> ServeAnswer:
        """Answer one input line. Invalid input gets status `refused`; nothing is raised.

        What fails twice while it is scored gets status `evaluator_error`, and no numbers either.
        """
        try:
            request = decode(ServeRequest, line)
        except RecordError as error:
            return _no_score(None, f"the line is not a request; found: {error}")
        if request.image_id not in self._options.dataset.cases:
            return _no_score(request, f"the dataset has no image {request.image_id}")
        scene = scene_below(self._options.root, request.scene)
        if scene is None:
            return _no_score(request, "the scene is not below the server's root folder (--root)")
        reason = ""
        for _ in range(2):
            try:
                return _answer(request, self._score_scene(request, scene))
            except Exception as error:  # one line may not end the server
                if self._aborted:
                    raise
                reason = f"{type(error).__name__}: {cause(error)}"
        return _no_score(request, reason, status=EVALUATOR_ERROR)

    def abort(self) -> None:
        """End the Blender process under a running `answer`, which raises."""
        self._aborted = True
        self._blender.abort()

    def close(self) -> None:
        """End the Blender process and remove what was written."""
        self._blender.close()
        self._scratch.close()

    def _score_scene(self, request: ServeRequest, scene: Path) -> ReconstructionRow:
        options = self._options
        case = options.dataset.cases[request.image_id]
        image = TrackImage(
            id=request.image_id,
            file_name=case.file_name,
            size_wh=case.size_wh,
            scene=scene.name,
            hfov_deg=case.image.hfov_deg,
        )
        record = read_image(image, self._readout(scene.parent), self._blender)
        task = CaseTask(
            run=self._scratch.path,
            row=to_record(BenchRow, as_json(record.row)),
            case=case,
            folders=options.dataset.folders,
            protocol=options.bench,
            choices=Choices(diagnostics=options.diagnostics),
        )
        return score_case(task)

    def _readout(self, scenes: Path) -> ImageOptions:
        options = self._options
        return ImageOptions(
            scenes=scenes,
            run=self._scratch.path,
            protocol=protocol("bench", None),
            source="blend",
            cache=options.cache,
            require_frozen=False,
            max_side=None,
            threads=options.threads,
            bench=options.rules,
        )


def scene_below(root: Path, scene: str) -> Path | None:
    """A scene folder from a path, absolute or relative to the root; None if it is outside.

    Links are followed before the comparison.
    """
    try:
        place = (root / scene).resolve()
    except (OSError, ValueError, RuntimeError):  # NUL, halves of surrogate pairs, loops of links
        return None
    return place if place.is_relative_to(root.resolve()) else None


def _no_score(request: ServeRequest | None, reason: str, *, status: str = "refused") -> ServeAnswer:
    return ServeAnswer(
        id=request.id if request else None,
        scene=request.scene if request else None,
        image_id=request.image_id if request else None,
        status=status,
        reason=reason,
        V=None,
        R=None,
        A=None,
        S=None,
        objects=(),
        validity=None,
        flags=(),
        warnings=(),
    )


def _answer(request: ServeRequest, row: ReconstructionRow) -> ServeAnswer:
    return ServeAnswer(
        id=request.id,
        scene=request.scene,
        image_id=request.image_id,
        status=row.status,
        reason=row.reason,
        V=1 if row.valid else 0,
        R=row.R or 0.0,
        A=row.A,
        S=row.S,
        objects=row.objects,
        validity=row.validity,
        flags=row.flags,
        warnings=row.warnings,
    )


def _lines(stream: BinaryIO) -> Iterator[bytes]:
    """The lines of a stream; an overlong line is truncated and thus not a valid request."""
    while line := stream.readline(_LONGEST_LINE):
        yield line
        while len(line) == _LONGEST_LINE and not line.endswith(b"\n"):
            line = stream.readline(_LONGEST_LINE)


class ScoreServer:
    """Workers that answer lines, each one line at a time; answers come in the order they are done.

    At most two lines a worker are taken from the input ahead, and a line of more than 1 MiB is
    refused unread.
    """

    def __init__(self, options: ServeOptions, workers: int) -> None:
        self._workers = [ScoreWorker(options) for _ in range(workers)]
        self._idle: queue.SimpleQueue[ScoreWorker] = queue.SimpleQueue()
        for worker in self._workers:
            self._idle.put(worker)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        with ExitStack() as ends:
            for worker in self._workers:
                ends.callback(worker.close)

    def serve(self, stream: BinaryIO, say: Callable[[ServeAnswer], None]) -> None:
        """Answer every line that is not empty; returns when the input ends and all are answered."""
        ahead, saying = BoundedSemaphore(2 * len(self._workers)), Lock()

        def work(line: bytes) -> None:
            worker = self._idle.get()
            try:
                answer = worker.answer(line)
            finally:
                self._idle.put(worker)
                ahead.release()
            with saying:
                say(answer)

        pending: list[Future[None]] = []
        with ThreadPoolExecutor(len(self._workers)) as pool:
            try:
                for line in _lines(stream):
                    if line.strip():
                        ahead.acquire()
                        pending = [*(p for p in pending if not p.done()), pool.submit(work, line)]
                for future in pending:
                    future.result()
            except BaseException:
                for future in pending:
                    future.cancel()
                for worker in self._workers:
                    worker.abort()
                raise
