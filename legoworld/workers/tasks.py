"""One function over many items by an engine, with the results in the items' order.

What is worked on is Python, so several workers of one machine are processes, not threads. Nothing a
result depends on comes from the crew: any one gives what `map` gives, the same error included.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar, overload

from legoworld.workers.engines import ENGINES, EngineName, Job, Worker
from legoworld.workers.task_process import ProcessLostError, TaskProcess, carried

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True)
class Crew:
    """Who works: an engine, and how many workers it may use."""

    engine: EngineName = "local"
    workers: int = 1

    @property
    def alone(self) -> bool:
        """Whether there is nobody but the calling process."""
        return self.engine == "local" and self.workers < 2

    def for_work(self, *, worth_a_process: bool) -> Crew:
        """The crew; the calling process alone for what costs less than starting another."""
        return self if worth_a_process or self.engine != "local" else ALONE


#: The calling process.
ALONE = Crew()


def results_of(
    function: Callable[[Item], Result], items: Sequence[Item], crew: Crew
) -> Iterator[Result]:
    """function(item) of every item, in their order.

    function: pure, and importable by its name where the workers are. An item is taken from `items`
    when a worker is free for it, so a sequence that makes them is never in memory as a whole. What
    the function raises is raised here: of the first item that it raises for, in their order.
    ProcessLostError when a worker's process ends, or its machine is lost three times.
    """
    if crew.alone:
        for index in range(len(items)):
            yield function(items[index])
        return
    kind = _ProcessWorker[Item, Result] if crew.engine == "local" else _DirectWorker[Item, Result]
    make: Callable[[], Worker[tuple[int, Item], _Outcome[Result]]] = partial(kind, function)
    job: Job[tuple[int, Item], _Outcome[Result]] = Job(make=make, lost=_lost)
    waiting: dict[int, _Outcome[Result]] = {}
    following = 0
    with closing(ENGINES[crew.engine](job, _Numbered(items), crew.workers)) as outcomes:
        for outcome in outcomes:
            waiting[outcome.number] = outcome
            while following in waiting:
                yield waiting.pop(following).value()
                following += 1


@dataclass(frozen=True)
class _Outcome(Generic[Result]):
    """What became of an item: a result, or what was raised."""

    number: int
    result: Result | None
    error: Exception | None

    def value(self) -> Result:
        if self.error is not None:
            raise self.error
        return self.result  # type: ignore[return-value]  # None is a result, too


class _DirectWorker(Generic[Item, Result]):
    """Works in the process it is made in: an actor of a cluster is one already."""

    def __init__(self, function: Callable[[Item], Result]) -> None:
        self._function = function

    def do(self, item: tuple[int, Item]) -> _Outcome[Result]:
        number, argument = item
        try:
            return _Outcome(number, self._function(argument), None)
        except Exception as error:  # noqa: BLE001  raised where the results are asked for
            return _Outcome(number, None, carried(error))

    def abort(self) -> None:
        pass

    def close(self) -> None:
        pass


class _ProcessWorker(Generic[Item, Result]):
    """Has items worked on in a process of its own."""

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


class _Numbered(Sequence[tuple[int, Item]]):
    """Items with their places, each taken when it is asked for."""

    def __init__(self, items: Sequence[Item]) -> None:
        self._items = items

    def __len__(self) -> int:
        return len(self._items)

    @overload
    def __getitem__(self, index: int) -> tuple[int, Item]: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[tuple[int, Item]]: ...
    def __getitem__(self, index: Any) -> Any:
        """An item and its place."""
        assert isinstance(index, int)
        return index, self._items[index]


def _lost(item: tuple[int, Item], what: str) -> _Outcome[Any]:
    error = ProcessLostError(
        "every machine that worked on a part of it was lost",
        found=what,
        expected="a machine that stays, with memory for its part",
        next_step="run the same command again, with fewer --workers where memory is short",
    )
    return _Outcome(item[0], None, error)
