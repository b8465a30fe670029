"""`legoworld bench serve`: submissions to scores, one by one, with warm workers."""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from threading import BoundedSemaphore, Lock
from typing import BinaryIO, Final, Self

from legoworld.bench.score_worker import Order, ProcessScorer, ServeOptions, no_score
from legoworld.errors import Raised
from legoworld.records.base import RecordError, decode
from legoworld.records.bench_results import ServeAnswer, ServeRequest
from legoworld.records.reconstruction import EVALUATOR_ERROR
from legoworld.workers.scratch import ScratchFolder
from legoworld.workers.task_process import ProcessLostError, TaskProcess

_LONGEST_LINE: Final = 1 << 20
#: Processes that an order may lose: the order may be the cause.
_TRIES: Final = 3


class ScoreServer:
    """Workers in processes of their own, each of which answers one order at a time.

    An order whose process is killed is given to a fresh one. Everything that is written lies below
    one scratch folder.
    """

    def __init__(self, options: ServeOptions, workers: int) -> None:
        self._folder = ScratchFolder("legoworld-serve-")
        self._aborted = False
        self._idle: queue.SimpleQueue[TaskProcess[Order, ServeAnswer]] = queue.SimpleQueue()
        self._workers = [
            TaskProcess[Order, ServeAnswer](ProcessScorer(options, self._folder.path))
            for _ in range(workers)
        ]
        for worker in self._workers:
            self._idle.put(worker)
        self._threads = ThreadPoolExecutor(workers)
        self._losing = Lock()
        #: Processes that were killed, or ended, with an order.
        self.n_lost = 0

    @property
    def workers(self) -> int:
        """How many there are."""
        return len(self._workers)

    @property
    def scratch(self) -> Path:
        """Temporary folder, deleted with the server."""
        return self._folder.path

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        """End every process, whatever it is doing; what still runs fails."""
        self.abort()
        self._threads.shutdown(cancel_futures=True)
        with ExitStack() as ends:
            ends.callback(self._folder.close)
            for worker in self._workers:
                ends.callback(worker.close)

    def submit(self, order: Order) -> Future[ServeAnswer]:
        """The order's answer once a worker is free for it; in the order that they are given."""
        return self._threads.submit(self._answer, order)

    def abort(self) -> None:
        """End the processes under the orders that are scored, which fail, and so does any later."""
        self._aborted = True
        for worker in self._workers:
            worker.abort()

    def serve(self, stream: BinaryIO, say: Callable[[ServeAnswer], None]) -> None:
        """Answer every line that is not empty; returns when the input ends and all are answered.

        Answers come in the order they are done. At most two lines a worker are taken from the input
        ahead, and a line of more than 1 MiB is refused unread.
        """
        ahead, saying = BoundedSemaphore(2 * self.workers), Lock()

        def work(line: bytes) -> None:
            try:
                answer = self._answer(Order(line=line))
            finally:
                ahead.release()
            with saying:
                say(answer)

        pending: list[Future[None]] = []
        try:
            for line in _lines(stream):
                if line.strip():
                    ahead.acquire()
                    waiting = (p for p in pending if not p.done())
                    pending = [*waiting, self._threads.submit(work, line)]
            for future in pending:
                future.result()
        except BaseException:
            for future in pending:
                future.cancel()
            self.abort()
            raise

    def _answer(self, order: Order) -> ServeAnswer:
        worker = self._idle.get()
        try:
            reason = ""
            for _ in range(_TRIES):
                try:
                    return worker.call(order)
                except ProcessLostError as error:
                    if self._aborted:
                        raise
                    with self._losing:
                        self.n_lost += 1
                    reason = str(error)
            return no_score(_request(order), reason, status=EVALUATOR_ERROR)
        finally:
            self._idle.put(worker)


def _request(order: Order) -> ServeRequest | None:
    try:
        return decode(ServeRequest, order.line)
    except RecordError:
        return None


def _lines(stream: BinaryIO) -> Iterator[bytes]:
    """The lines of a stream; an overlong line is truncated and thus not a valid request."""
    while line := stream.readline(_LONGEST_LINE):
        yield line
        while len(line) == _LONGEST_LINE and not line.endswith(b"\n"):
            line = stream.readline(_LONGEST_LINE)
