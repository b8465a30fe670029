"""One function over many items: any pool gives what `map` gives, the same error included."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from legoworld.errors import LegoWorldError, UsageError
from legoworld.workers.task_process import ProcessLostError, TaskProcess
from legoworld.workers.tasks import IN_PROCESS, WorkerPool, map_items

POOLS = [IN_PROCESS, WorkerPool(workers=2), WorkerPool(workers=5)]


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers import this file by its name."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))


def square(n: int) -> tuple[int, int]:
    time.sleep(0.002 * (7 - n % 8))  # the first ones are ready last
    print("not an answer")
    return n * n, os.getpid()


def refusing(n: int) -> int:
    time.sleep(0.05 * (n == 3))
    if n >= 3:
        raise UsageError("refused", found=str(n), next_step="nothing")
    return n


class TwoArgumentsError(Exception):
    """Cannot be pickled: it is made again from one argument."""

    def __init__(self, what: str, more: str) -> None:
        super().__init__(f"{what} {more}")


def stubborn(n: int) -> int:
    raise TwoArgumentsError("odd", str(n))


def ending(n: int) -> int:
    if n == 1:
        print("out of luck", file=sys.stderr, flush=True)
        os._exit(3)
    return n


class Lazy(Sequence[int]):
    """Counts what was taken from it."""

    def __init__(self, n: int) -> None:
        self.n, self.taken = n, 0

    def __len__(self) -> int:
        return self.n

    def __getitem__(self, index):
        self.taken += 1
        return index


@pytest.mark.parametrize("pool", POOLS)
def test_results_come_in_the_items_order(pool):
    found = list(map_items(square, range(40), pool))
    assert [square for square, _ in found] == [n * n for n in range(40)]
    processes = {process for _, process in found}
    assert (os.getpid() in processes) == pool.in_process
    assert 1 <= len(processes) <= pool.workers


@pytest.mark.parametrize("pool", POOLS)
def test_the_first_error_in_order_is_raised_whole(pool):
    found = []
    with pytest.raises(UsageError) as caught:
        found.extend(map_items(refusing, range(9), pool))
    assert str(caught.value) == "refused; found: 3; next: nothing"
    assert caught.value.next_step == "nothing"


def test_an_error_that_cannot_travel_is_told():
    with pytest.raises(RuntimeError, match="TwoArgumentsError: odd 0"):
        list(map_items(stubborn, range(3), WorkerPool(workers=2)))


def test_a_process_that_ends_is_an_error_with_its_last_words():
    with pytest.raises(ProcessLostError, match="exit code 3; out of luck"):
        list(map_items(ending, range(3), WorkerPool(workers=2)))


def test_items_are_taken_when_a_worker_is_free():
    items = Lazy(5000)
    results = map_items(square, items, WorkerPool(workers=2))
    next(results)
    assert items.taken < 5000
    results.close()
    assert items.taken < 5000


def test_what_is_too_little_for_another_process():
    pool = WorkerPool(workers=4)
    assert pool.for_work(worth_a_process=True) is pool
    assert pool.for_work(worth_a_process=False).in_process
    assert not WorkerPool(engine="ray").for_work(worth_a_process=False).in_process


def test_an_aborted_process_answers_no_more():
    process = TaskProcess(square)
    assert process.call(3)[0] == 9
    process.abort()
    for _ in range(2):
        with pytest.raises(LegoWorldError, match="signal 9"):
            process.call(3)
    process.close()
