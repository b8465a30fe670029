"""Blender processes that tests hand on: a start takes half a second of a core, a scene much less.

Under `handing_on`, a `BlenderProcess` that is closed leaves its process, if it is idle and
well, to the next one with the same environment. What one scene changes for the next is what every
run of two scenes would meet as well. Tests of the start itself are marked `own_blender`.
"""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import pytest

from legoworld.errors import LegoWorldError
from legoworld.scene.blender_process import BlenderProcess
from legoworld.workers.child_process import ChildProcess
from legoworld.workers.environment import blender_environment
from legoworld.workers.scratch import ScratchFolder

#: A process is closed after this many owners: Blender's memory grows slowly with each scene.
_OWNERS: Final = 40
_AT_MOST: Final = 2


@dataclass(kw_only=True)
class _Kept:
    process: ChildProcess
    home: ScratchFolder
    started_in: tuple[Any, ...]
    owners: int = 1
    #: A request that was left before its answer was read.
    unanswered: bool = False

    def close(self) -> None:
        self.process.close()
        self.home.close()


@dataclass(kw_only=True)
class HandedOn:
    """The processes that wait for an owner, and those that have one."""

    active: bool = True
    _idle: list[_Kept] = field(default_factory=list)
    _owned: dict[int, _Kept] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def take(self, owner: BlenderProcess) -> None:
        """Give an idle process to an owner without one, where one fits."""
        here = _surroundings()
        with self._lock:
            for kept in [k for k in self._idle if k.process.exit_code() is not None]:
                self._idle.remove(kept)
                kept.close()
            fitting = next((k for k in self._idle if k.started_in == here), None)
            if fitting is not None:
                self._idle.remove(fitting)
        if fitting is not None:
            fitting.owners += 1
            owner._process, owner._home, owner._n_requests = fitting.process, fitting.home, 0
            self._owned[id(fitting.process)] = fitting

    def note(self, owner: BlenderProcess) -> None:
        """A process that an owner has just started."""
        if owner._process is not None and owner._home is not None:
            self._owned[id(owner._process)] = _Kept(
                process=owner._process, home=owner._home, started_in=_surroundings()
            )

    def leave(self, owner: BlenderProcess) -> None:
        """Keep what a closing owner has, if it is idle and well."""
        kept = self._owned.pop(id(owner._process), None)
        if kept is None or kept.unanswered or kept.owners >= _OWNERS or owner._aborted:
            return
        if kept.process.exit_code() is None:
            owner._process = owner._home = None
            with self._lock:
                self._idle.append(kept)
                spare = self._idle.pop(0) if len(self._idle) > _AT_MOST else None
            if spare is not None:
                spare.close()

    def asking(self, owner: BlenderProcess, unanswered: bool) -> None:
        """Note whether an owner's process has still to answer."""
        if (kept := self._owned.get(id(owner._process))) is not None:
            kept.unanswered = unanswered

    def close(self) -> None:
        """End every process that waits."""
        while self._idle:
            self._idle.pop().close()


@contextmanager
def handing_on(hub: HandedOn) -> Iterator[None]:
    """Processes are handed on through the hub while it is `active`."""
    started, ask = BlenderProcess._start_worker, BlenderProcess._ask
    abort, close = BlenderProcess.abort, BlenderProcess.close

    def take_or_start(self: BlenderProcess) -> ChildProcess:
        if not hub.active:
            return started(self)
        if self._process is None and not self._aborted:
            hub.take(self)
        if self._process is None:
            starter.submit(started, self).result()
            hub.note(self)
        return started(self)

    def noted(self: BlenderProcess, message: dict[str, Any]) -> dict[str, Any]:
        self._start_worker()
        hub.asking(self, unanswered=True)
        try:
            answer = ask(self, message)
        except LegoWorldError:  # the worker's answer, or it was ended
            hub.asking(self, unanswered=False)
            raise
        hub.asking(self, unanswered=False)
        return answer

    def leave_or_abort(self: BlenderProcess) -> None:
        """Commands abort all their workers in the end: one that is idle can serve again."""
        if hub.active and self._process is not None:
            hub.leave(self)
        abort(self)

    def leave_or_close(self: BlenderProcess) -> None:
        if hub.active and self._process is not None:
            hub.leave(self)
        close(self)

    # The kernel ends a worker with the thread that started it: this one is there to the end.
    with ThreadPoolExecutor(1) as starter, pytest.MonkeyPatch.context() as patch:
        patch.setattr(BlenderProcess, "_start_worker", take_or_start)
        patch.setattr(BlenderProcess, "_ask", noted)
        patch.setattr(BlenderProcess, "abort", leave_or_abort)
        patch.setattr(BlenderProcess, "close", leave_or_close)
        try:
            yield
        finally:
            hub.close()


def _surroundings() -> tuple[Any, ...]:
    """What a process takes over from its parent when it starts."""
    environment = blender_environment(home=Path("home"), temporary=Path("temporary"))
    return (os.getpid(), tempfile.gettempdir(), *sorted(environment.items()))
