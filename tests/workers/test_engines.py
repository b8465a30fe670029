"""Who works on the items of a batch: each once, in whatever order, and everything is given back."""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from collections import Counter
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from waiting import PATIENCE_S, until

from legoworld.errors import WorkerCrashedError
from legoworld.workers.engines import (
    ENGINES,
    ClusterUnreachableError,
    EngineMissingError,
    Job,
    engine_cores,
    machine_lost,
    run_local,
    run_ray,
)
from legoworld.workers.task_process import ProcessLostError, TaskProcess, make_picklable
from legoworld.workers.tasks import IN_PROCESS, WorkerPool, map_items


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers import this file, and what it imports, by name."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))


class Books:
    """What the workers of one job did."""

    def __init__(self) -> None:
        self.made: list[Recording] = []
        self.lock = threading.Lock()

    def make(self) -> Recording:
        self.made.append(Recording(self))
        return self.made[-1]

    def count(self, name: str) -> list[int]:
        return [getattr(worker, name) for worker in self.made]


class Recording:
    def __init__(self, books: Books) -> None:
        self.books = books
        self.items: list[int] = []
        self.aborted = self.closed = 0
        self.stop = threading.Event()
        self.busy = False

    def do(self, item: int) -> int:
        assert not self.busy  # one item at a time
        self.busy = True
        self.items.append(item)
        if item < 0:  # until it is aborted
            assert self.stop.wait(PATIENCE_S)
        time.sleep(0.001)
        self.busy = False
        return item * item

    def abort(self) -> None:
        self.aborted += 1
        self.stop.set()

    def close(self) -> None:
        self.closed += 1


def lost(item: int, what: str) -> int:
    raise AssertionError("no machine is lost here")


@pytest.mark.parametrize("workers", [1, 3, 50])
def test_every_item_is_done_once_by_as_many_workers_as_there_is_work_for(workers):
    books = Books()
    items = [*range(7)]
    results = [*run_local(Job(make=books.make, lost_result=lost), items, workers)]
    assert sorted(results) == [i * i for i in items]
    assert len(books.made) == min(workers, 7)
    assert sorted(item for worker in books.made for item in worker.items) == items
    assert books.count("closed") == [1] * len(books.made)


@pytest.mark.parametrize("workers", [0, 1])
def test_nothing_to_do_is_no_result(workers):
    books = Books()
    assert [*run_local(Job(make=books.make, lost_result=lost), [], workers)] == []
    assert books.count("closed") == [1]


def test_who_stops_early_aborts_what_is_being_done():
    books = Books()
    with closing(
        run_local(Job(make=books.make, lost_result=lost), [3, -1, -2, 4, 5], 2)
    ) as results:
        assert next(results) == 9
    assert all(books.count("aborted"))
    assert books.count("closed") == [1, 1]


def test_what_a_worker_raises_ends_the_batch_and_closes_all():
    class Failing(Recording):
        def do(self, _item: int) -> int:
            raise OSError("the disk is full")

    books = Books()

    def make() -> Recording:
        books.made.append(Failing(books))
        return books.made[-1]

    with pytest.raises(OSError, match="the disk is full"):
        next(run_local(Job(make=make, lost_result=lost), [1, 2, 3], 2))
    assert books.count("closed") == [1, 1]


def test_the_engines_have_names():
    assert set(ENGINES) == {"local", "ray"}
    assert ENGINES["local"] is run_local


def test_an_engine_that_is_not_installed_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(EngineMissingError, match=r"pip install 'ray>=2\.40'") as caught:
        engine_cores("ray")
    assert caught.value.exit_code == 4


class DiedError(Exception):
    """ray.exceptions.RayActorError of a cluster made of this process."""


class Pending:
    def __init__(self, item: object, lost: bool, actor: Any) -> None:
        self.item, self.lost, self.actor = item, lost, actor


class HereRay:
    """As much of Ray as run_ray asks for; an item that is a text is lost so many times first."""

    exceptions = SimpleNamespace(RayActorError=DiedError)

    def __init__(self) -> None:
        self.made: list[object] = []
        self.killed: list[object] = []
        self.tries: Counter[object] = Counter()

    def is_initialized(self) -> bool:
        return True

    def remote(self, **options: object) -> Any:
        assert options == {"num_cpus": 1}
        return lambda actor: SimpleNamespace(remote=lambda make: self._actor(actor(make)))

    def _actor(self, actor: Any) -> Any:
        def later(item: object) -> object:
            self.tries[item] += 1
            lost = isinstance(item, str) and self.tries[item] <= int(item)
            return Pending(item, lost, actor)

        self.made.append(SimpleNamespace(do=SimpleNamespace(remote=later)))
        return self.made[-1]

    def wait(self, pending: list[Any], num_returns: int) -> tuple[list[Any], list[Any]]:
        assert num_returns == 1
        return pending[-1:], pending[:-1]  # the last that was given is done first

    def get(self, pending: Any) -> Any:
        if pending.lost:
            raise DiedError
        return pending.actor.do(pending.item)

    def kill(self, actor: object) -> None:
        self.killed.append(actor)


class Echo:
    def do(self, item: object) -> object:
        return ("done", item)


def by_ray(monkeypatch: pytest.MonkeyPatch, items: list[Any], workers: int) -> tuple[HereRay, Any]:
    ray = HereRay()
    monkeypatch.setitem(sys.modules, "ray", ray)
    job = Job(make=Echo, lost_result=lambda item, what: ("lost", item, what))
    return ray, run_ray(job, items, workers)


@pytest.mark.parametrize("workers", [0, 1, 3, 50])
def test_a_cluster_does_every_item_once_and_gives_every_cpu_back(workers, monkeypatch):
    ray, results = by_ray(monkeypatch, [*range(7)], workers)
    assert sorted(results) == [("done", i) for i in range(7)]
    assert len(ray.made) == max(1, min(workers, 7))
    assert {*map(id, ray.killed)} == {*map(id, ray.made)}
    assert {*ray.tries.values()} == {1}


@pytest.mark.parametrize(("times", "tries"), [(0, 1), (1, 2), (2, 3), (3, 3), (9, 3)])
def test_an_item_whose_machine_is_lost_is_tried_three_times(times, tries, monkeypatch):
    ray, results = by_ray(monkeypatch, [1, str(times), 2], 2)
    last = ("done", str(times)) if times < 3 else ("lost", str(times), "DiedError")
    assert sorted(results, key=str) == sorted([("done", 1), last, ("done", 2)], key=str)
    assert ray.tries == {1: 1, str(times): tries, 2: 1}
    # Each that was lost is replaced; what is lost is not killed again.
    assert len(ray.made) == 2 + min(times, 3)
    assert len(ray.killed) == 2


def test_a_cluster_that_is_left_early_gives_every_cpu_back(monkeypatch):
    ray, results = by_ray(monkeypatch, [*range(9)], 3)
    with closing(results):
        next(results)
    assert len(ray.killed) == len(ray.made) == 3


class NoRay:
    """What the real package is asked: it would look for the cluster for minutes."""

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []

    def is_initialized(self) -> bool:
        return bool(self.asked)

    def init(self, **options: Any) -> None:
        self.asked.append(options)

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 6.0, "memory": 1e9}


@pytest.mark.parametrize("prefix", ["", "ray://"])
def test_a_cluster_where_nobody_listens_is_one_line(prefix, monkeypatch):
    ray = NoRay()
    monkeypatch.setitem(sys.modules, "ray", ray)
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))  # nobody else can have it meanwhile
        port = bound.getsockname()[1]
        monkeypatch.setenv("RAY_ADDRESS", f"{prefix}127.0.0.1:{port}")
        with pytest.raises(ClusterUnreachableError) as caught:
            engine_cores("ray")
    assert f"RAY_ADDRESS={prefix}127.0.0.1:{port}: " in str(caught.value)
    assert caught.value.exit_code == 4
    assert ray.asked == []


@pytest.mark.parametrize("address", ["listening", "auto", "odd:port", None])
def test_a_cluster_that_may_be_there_is_asked_once(address, monkeypatch):
    ray = NoRay()
    monkeypatch.setitem(sys.modules, "ray", ray)
    with socket.create_server(("127.0.0.1", 0)) as server:
        if address == "listening":
            address = f"127.0.0.1:{server.getsockname()[1]}"
        monkeypatch.delenv("RAY_ADDRESS", raising=False)
        if address is not None:
            monkeypatch.setenv("RAY_ADDRESS", address)
        assert engine_cores("ray") == 6
        assert engine_cores("ray") == 6
    assert [asked["address"] for asked in ray.asked] == [address]


def test_this_machine_has_the_cores_this_process_may_use():
    assert engine_cores("local") == len(os.sched_getaffinity(0))


def test_a_lost_machine_is_a_worker_that_crashed():
    error = machine_lost("ActorDiedError")
    assert isinstance(error, WorkerCrashedError)
    assert "found: ActorDiedError" in str(error)


# Functions over items, in processes.


def square(number: int) -> int:
    return number * number


def told(number: int) -> tuple[int, str, str]:
    print("not an answer")
    if marks := os.environ.get("MARKS"):  # nobody does everything before the other one has begun
        Path(marks, str(os.getpid())).touch()
        until(lambda: len(list(Path(marks).iterdir())) == 2, "the start of both workers")
    return os.getpid(), os.environ["OMP_NUM_THREADS"], os.environ["OPENBLAS_NUM_THREADS"]


def odd_fails(number: int) -> int:
    if number % 2:
        time.sleep(0.05 if number < 5 else 0)  # a later one fails first
        raise ValueError(f"odd: {number}")
    return number


def ends(number: int) -> int:
    if number == 2:
        os.write(2, b"first line\nlast words\n")
        os._exit(7)
    return number


class UnpicklableError(Exception):
    def __init__(self, one: str, two: str) -> None:
        super().__init__(f"{one} {two}")


def raises_unpicklable(number: int) -> int:
    raise UnpicklableError("what", "happened")


POOLS = [IN_PROCESS, WorkerPool(workers=3)]


@pytest.mark.parametrize("pool", POOLS, ids=str)
def test_results_have_the_items_order(pool):
    assert [*map_items(square, range(20), pool)] == [i * i for i in range(20)]
    assert [*map_items(square, [], pool)] == []


@pytest.mark.parametrize("pool", POOLS, ids=str)
def test_the_first_error_in_the_items_order_is_raised_after_the_results_before_it(pool):
    results = map_items(odd_fails, [0, 2, 4, 3, 5], pool)
    assert [next(results) for _ in range(3)] == [0, 2, 4]
    with pytest.raises(ValueError, match="odd: 3"):
        next(results)


def test_workers_are_other_processes_of_one_thread_each(tmp_path, monkeypatch):
    monkeypatch.setenv("MARKS", str(tmp_path))
    found = [*map_items(told, range(6), WorkerPool(workers=2))]
    pids = {pid for pid, _, _ in found}
    assert os.getpid() not in pids
    assert len(pids) == 2
    assert {threads for _, *threads in map(list, found) for threads in threads} == {"1"}


def test_a_process_that_ends_is_said_with_its_last_words():
    results = map_items(ends, [1, 2, 3], WorkerPool(workers=2))
    assert next(results) == 1
    with pytest.raises(ProcessLostError, match="exit code 7; last words") as caught:
        next(results)
    assert caught.value.exit_code == 4


def test_an_item_whose_machine_is_lost_is_an_error_at_its_own_place(monkeypatch):
    class Losing(HereRay):
        def get(self, pending: Any) -> Any:
            if pending.item[1] == 4:
                raise DiedError
            return super().get(pending)

    monkeypatch.setitem(sys.modules, "ray", Losing())
    results = map_items(square, [2, 3, 4, 5], WorkerPool(engine="ray", workers=2))
    assert [next(results), next(results)] == [4, 9]
    with pytest.raises(ProcessLostError, match="found: DiedError") as caught:
        next(results)
    assert caught.value.exit_code == 4


def test_one_worker_of_this_machine_is_the_calling_process():
    assert IN_PROCESS.in_process
    assert WorkerPool(workers=1).in_process
    assert not WorkerPool(workers=2).in_process
    assert not WorkerPool(engine="ray", workers=1).in_process
    two, ray = WorkerPool(workers=2), WorkerPool(engine="ray", workers=2)
    assert two.for_work(worth_a_process=True) is two
    assert two.for_work(worth_a_process=False) is IN_PROCESS
    assert ray.for_work(worth_a_process=False) is ray


def test_an_error_that_cannot_travel_is_said_in_another():
    error = ValueError("as it is")
    assert make_picklable(error) is error
    assert (
        repr(make_picklable(UnpicklableError("a", "b"))) == "RuntimeError('UnpicklableError: a b')"
    )
    process = TaskProcess(raises_unpicklable)
    with closing(process), pytest.raises(RuntimeError, match="UnpicklableError: what happened"):
        process.call(1)


def test_a_process_is_kept_and_ends_when_it_is_closed():
    process = TaskProcess(told)
    (pid, *_), (again, *_) = process.call(0), process.call(1)
    assert pid == again
    process.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    process.close()  # twice is nothing


def test_who_is_aborted_does_nothing_more():
    process = TaskProcess(square)
    assert process.call(3) == 9
    process.abort()
    for _ in range(2):
        with pytest.raises(ProcessLostError, match="signal 9"):
            process.call(4)
    process.close()
