"""Engines that process the items of a batch: threads of this machine, or a Ray cluster.

An engine takes a factory of workers and the items, and yields results in order of completion.
Results must not depend on the engine: which worker gets which item, and when, is not deterministic.
"""

from __future__ import annotations

import importlib
import os
import queue
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Any, Final, Generic, Literal, Protocol, TypeVar

from legoworld import exit_codes, extras
from legoworld.errors import LegoWorldError, WorkerCrashedError, cause
from legoworld.workers.processors import usable_cores

Item = TypeVar("Item")
Result = TypeVar("Result")
Item_contra = TypeVar("Item_contra", contravariant=True)
Result_co = TypeVar("Result_co", covariant=True)

EngineName = Literal["local", "ray"]
#: Maximum number of attempts at an item whose machine is lost: the item may be the cause.
_TRIES: Final = 3


class EngineMissingError(LegoWorldError):
    """The package an engine needs is not installed."""

    code = "engine_missing"
    exit_code = exit_codes.BLOCKED


class ClusterUnreachableError(LegoWorldError):
    """No Ray cluster answers at the given address."""

    code = "cluster_unreachable"
    exit_code = exit_codes.BLOCKED


class Worker(Protocol[Item_contra, Result_co]):
    """Processes one item at a time. It is created where it runs, so it may own a process."""

    def do(self, item: Item_contra, /) -> Result_co:
        """The result of an item. An item's failure is a result, never an exception."""
        ...

    def abort(self) -> None:
        """End a running `do`; called from another thread."""

    def close(self) -> None:
        """Release all resources."""


@dataclass(frozen=True, kw_only=True)
class Job(Generic[Item, Result]):
    """The input of an engine. `make` must be picklable; `lost_result`: of a lost item."""

    make: Callable[[], Worker[Item, Result]]
    lost_result: Callable[[Item, str], Result]


def run_local(
    job: Job[Item, Result], items: Sequence[Item], workers: int
) -> Generator[Result, None, None]:
    """Results in order of completion, from threads of this process, each with its own worker."""
    made = [job.make() for _ in range(max(1, min(workers, len(items))))]
    idle: queue.LifoQueue[Worker[Item, Result]] = queue.LifoQueue()
    for worker in made:
        idle.put(worker)
    done: dict[int, Result] = {}  # not in the futures: they live until the batch ends

    def work(number: int) -> int:
        worker = idle.get()
        try:
            done[number] = worker.do(items[number])
        finally:
            idle.put(worker)
        return number

    try:
        with ThreadPoolExecutor(len(made)) as pool:
            pending: list[Future[int]] = [pool.submit(work, n) for n in range(len(items))]
            try:
                for future in as_completed(pending):
                    yield done.pop(future.result())
            finally:
                # Stopped early (Ctrl-C, a full disk): what the workers still do is in vain.
                for future in pending:
                    future.cancel()
                for worker in made:
                    worker.abort()
    finally:
        for worker in made:
            worker.close()


def run_ray(
    job: Job[Item, Result], items: Sequence[Item], workers: int
) -> Generator[Result, None, None]:
    """Results in order of completion, from actors of a Ray cluster, one CPU each.

    The cluster is RAY_ADDRESS's, or one started on this machine. An item whose machine is lost is
    retried on another, at most three times; then `job.lost_result` is its result.
    """
    ray = _started_ray()
    actor = ray.remote(num_cpus=1)(_RemoteWorker)
    waiting = list(range(len(items)))[::-1]
    tries = [0] * len(items)
    idle = [actor.remote(job.make) for _ in range(max(1, min(workers, len(items))))]
    busy: dict[Any, tuple[int, Any]] = {}
    try:
        while waiting or busy:
            while idle and waiting:
                number, worker = waiting.pop(), idle.pop()
                tries[number] += 1
                busy[worker.do.remote(items[number])] = number, worker
            while idle:  # nothing is left for it: its CPU may be what another waits for
                ray.kill(idle.pop())
            ready, _ = ray.wait(list(busy), num_returns=1)
            number, worker = busy.pop(ready[0])
            try:
                result = ray.get(ready[0])
            except ray.exceptions.RayActorError as error:
                idle.append(actor.remote(job.make))
                if tries[number] < _TRIES:
                    waiting.append(number)
                    continue
                result = job.lost_result(items[number], type(error).__name__)
            else:
                idle.append(worker)
            yield result
    finally:
        for worker in [*idle, *(worker for _, worker in busy.values())]:
            ray.kill(worker)


class _RemoteWorker:
    """The actor: makes its worker on the machine it was placed on."""

    def __init__(self, make: Callable[[], Worker[Any, Any]]) -> None:
        self._worker = make()

    def do(self, item: Any) -> Any:
        return self._worker.do(item)


def machine_lost(what: str) -> WorkerCrashedError:
    """The error of an item whose machine was lost at every attempt."""
    return WorkerCrashedError(
        "every machine that had the scene was lost",
        found=what,
        expected="a machine that stays, with memory for the scene",
        next_step="run the same command again, with fewer --workers where memory is short",
    )


def engine_cores(engine: EngineName) -> int:
    """CPU cores available to an engine: this process's, or all of the Ray cluster's."""
    if engine == "local":
        return usable_cores()
    return int(_started_ray().cluster_resources().get("CPU", 1))


def _started_ray() -> Any:
    try:
        ray: Any = importlib.import_module("ray")
    except ImportError as error:
        raise EngineMissingError(
            "--engine ray needs the package ray",
            found="it is not installed",
            expected="legoworld's extra `ray`",
            next_step=extras.install_command("ray"),
        ) from error
    if not ray.is_initialized():
        address = os.environ.get("RAY_ADDRESS")
        try:
            _knock(address)
            ray.init(
                address=address, log_to_driver=False, include_dashboard=False, logging_level="ERROR"
            )
        except (OSError, ValueError, RuntimeError) as error:
            raise ClusterUnreachableError(
                "the Ray cluster cannot be reached",
                found=f"RAY_ADDRESS={address}: {cause(error)}" if address else cause(error),
                expected="a running cluster, or no RAY_ADDRESS to start one here",
                next_step="start one with `ray start --head`, or correct RAY_ADDRESS",
            ) from error
    return ray


def _knock(address: str | None) -> None:
    """Raise OSError if nothing listens at host:port: Ray itself would retry for minutes."""
    import socket

    host, _, port = (address or "").removeprefix("ray://").rpartition(":")
    if host and port.isdecimal():
        socket.create_connection((host, int(port)), timeout=10).close()


ENGINES: Final = {"local": run_local, "ray": run_ray}
