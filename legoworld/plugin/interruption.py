"""How the running call is told to end early, and how it tells how far it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event

from legoworld.errors import LegoWorldError

#: A step's number, of how many, and what it is.
Report = Callable[[int, int, str], None]


class CancelledCallError(LegoWorldError):
    """The client cancelled the call; nothing of it counts."""

    code = "cancelled_call"


class Interruption:
    """Asked for by one thread while another one works.

    A call asks between its steps; what it waits for meanwhile (a worker, a socket) is ended.
    """

    def __init__(self) -> None:
        self._request = Event()
        #: What ends the wait of any call.
        self.ends: list[Callable[[], None]] = []
        self._report: Report | None = None

    @property
    def is_requested(self) -> bool:
        """Whether the running call has to end."""
        return self._request.is_set()

    def begin(self, report: Report | None) -> None:
        """Another call: no interruption is requested yet. report: called at each step."""
        self._request.clear()
        self._report = report

    def ask(self) -> None:
        """End the running call: every process and line that it waits for."""
        self._request.set()
        for end in [*self.ends]:
            end()

    def step(self, number: int, of: int, what: str) -> None:
        """Before a step of the call. CancelledCallError where it has to end."""
        if self.is_requested:
            raise cancelled_error()
        if self._report is not None:
            self._report(number, of, what)

    @contextmanager
    def ending(self, end: Callable[[], None]) -> Iterator[None]:
        """What ends the wait of a block."""
        self.ends.append(end)
        try:
            if self.is_requested:
                raise cancelled_error()
            yield
        finally:
            self.ends.remove(end)


def cancelled_error() -> CancelledCallError:
    """The error of a call that its client cancelled."""
    return CancelledCallError(
        "the client cancelled the call",
        found="a cancellation while it ran",
        expected="a call that runs to its end",
        next_step="call status: the case is where it was before the call",
    )
