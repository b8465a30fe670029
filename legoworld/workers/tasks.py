"""One function over many items by an engine, with the results in the order of the items.

The work is Python code, so the workers of one machine are processes, not threads. Results do not
depend on the pool: any pool gives what `map` gives, including the same error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar, overload

from legoworld.workers.engines import ENGINES, EngineName, Job, Worker
from legoworld.workers.task_process import ProcessLostError, TaskProcess, make_picklable

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True)
class WorkerPool:
    """An engine and the number of workers it may use."""

    engine: EngineName = "local"
    workers: int = 1

    @property
    def in_process(self) -> bool:
        """Whether all work is done in the calling process."""
        return self.engine == "local" and self.workers < 2

    def for_work(self, *, worth_a_process: bool) -> WorkerPool:
        """The pool, or the calling process alone if the work costs less than starting another."""
        return self if worth_a_process or self.engine != "local" else IN_PROCESS


#: All work in the calling process.
IN_PROCESS = WorkerPool()


def map_items(
    function: Callable[[Item], Result], items: Sequence[Item], pool: WorkerPool
) -> Iterator[Result]:
    """function(item) of every item, in their order.

    function: pure, and importable by its name where the workers run. An item is taken from `items`
    when a worker is free, so a lazy sequence is never in memory as a whole. Exceptions of the
    function are raised here: that of the first failing item in order. ProcessLostError when a
    worker's process ends, or its machine is lost three times.
    """
    if pool.in_process:
        for index in range(len(items)):
            yield function(items[index])
        return
    kind = _ProcessWorker[Item, Result] if pool.engine == "local" else _DirectWorker[Item, Result]
    make: Callable[[], Worker[tuple[int, Item], _Outcome[Result]]] = partial(kind, function)
    job: Job[tuple[int, Item], _Outcome[Result]] = Job(make=make, lost_result=_lost_outcome)
    waiting: dict[int, _Outcome[Result]] = {}
    following = 0
    with closing(ENGINES[pool.engine](job, _NumberedItems(items), pool.workers)) as outcomes:
        for outcome in outcomes:
            waiting[outcome.number] = outcome
            while following in waiting:
                yield waiting.pop(following).value()
                following += 1


@dataclass(frozen=True)
class _Outcome(Generic[Result]):
    """The outcome of an item: a result or an exception."""

    number: int
    result: Result | None
    error: Exception | None

    def value(self) -> Result:
        if self.error is not None:
            raise self.error
        return self.result  # type: ignore[return-value]  # None is a result, too


class _DirectWorker(Generic[Item, Result]):
    """Works in the process it is created in, such as an actor of a cluster."""

    def __init__(self, function: Callable[[Item], Result]) -> None:
        self._function = function

    def do(self, item: tuple[int, Item]) -> _Outcome[Result]:
        number, argument = item
        try:
            return _Outcome(number, self._function(argument), None)
        except Exception as error:  # noqa: BLE001  raised where the results are asked for
            return _Outcome(number, None, make_picklable(error))

    def abort(self) -> None:
        pass

    def close(self) -> None:
        pass


class _ProcessWorker(Generic[Item, Result]):
    """Has items processed in a separate process."""

    def __init__(self, function: Callable[[Item], Result]) -> None:
        self._process = TaskProcess(function)

    def do(self, item: tuple[int, Item]) -> _Outcome[Result]:
        number, argument = item
        try:
            return _Outcome(number, self._process.call(argument), None)
        except Exception as error:  # noqa: BLE001  raised where the results are asked for
            return _Outcome(number, None, error)

    def abort(self) -> None:
        self._process.abort()

    def close(self) -> None:
        self._process.close()


class _NumberedItems(Sequence[tuple[int, Item]]):
    """Items with their positions, taken lazily."""

    def __init__(self, items: Sequence[Item]) -> None:
        self._items = items

    def __len__(self) -> int:
        return len(self._items)

    @overload
    def __getitem__(self, index: int) -> tuple[int, Item]: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[tuple[int, Item]]: ...
    def __getitem__(self, index: int | slice) -> Any:
        """An item and its place."""
        assert isinstance(index, int)
        return index, self._items[index]


def _lost_outcome(item: tuple[int, Item], what: str) -> _Outcome[Any]:
    error = ProcessLostError(
        "every machine that worked on an item was lost",
        found=what,
        expected="a machine that stays, with enough memory for the item",
        next_step="run the same command again, with fewer --workers where memory is short",
    )
    return _Outcome(item[0], None, error)
