"""A baseline's process: started with one request, read line by line, ended with its group."""

from __future__ import annotations

import contextlib
import io
import json
import queue
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Final, Self

from legoworld import exit_codes
from legoworld.baselines.answers import Unreadable, read_line
from legoworld.baselines.cards import BaselineCard
from legoworld.errors import LegoWorldError, one_line
from legoworld.records.base import as_json
from legoworld.records.baseline_messages import ChildRequest, Message
from legoworld.workers.child_process import ChildProcess, last_line
from legoworld.workers.environment import ChildKind, child_environment
from legoworld.workers.scratch import ScratchFolder

_KEPT_LOG_LINES: Final = 60
_WAIT_FOR_END_S: Final = 5.0
_POLL_S: Final = 0.5
#: Maximum length of a line in memory: hundreds of masks of the largest photos are 10 MB.
_LONGEST_LINE: Final = 256 << 20
_LONGEST_LOG_LINE: Final = 1 << 16


class BaselineFailedError(LegoWorldError):
    """The baseline's process ended before it could work on any image."""

    code = "baseline_failed"
    exit_code = exit_codes.BLOCKED


class TooSlowError(Exception):
    """No message arrived within the time limit."""


class BaselineProcess:
    """One process of a baseline.

    declared: names of the caller's variables that it gets besides those every model gets.
    Lines on its standard output that are no messages, and its standard error, are its log and go
    to `log`; the last lines of standard error are kept for `last_words`.
    """

    def __init__(
        self,
        card: BaselineCard,
        python: Path,
        request: ChildRequest,
        log: Callable[[str], None],
        *,
        declared: Sequence[str] = (),
    ) -> None:
        self._log = log
        self._home = ScratchFolder("legoworld-baseline-")
        self._tail: deque[str] = deque(maxlen=_KEPT_LOG_LINES)
        self._messages: queue.Queue[Message | Unreadable | None] = queue.Queue()
        try:
            self._process = ChildProcess(
                [str(python), str(card.program)],
                _environment(card, self._home.path, declared, offline=request.offline),
                kept=(self._home.owner_fd,),
                error_pipe=True,
            )
        except OSError as error:
            self._home.close()
            raise BaselineFailedError(
                f"the baseline {card.name} cannot be started",
                found=f"{python}: {error.strerror}",
                expected="a Python that runs",
                next_step="pass another --python",
            ) from error
        assert self._process.stderr is not None
        self._readers = [
            threading.Thread(target=target, args=(stream,), daemon=True)
            for target, stream in (
                (self._read_messages, self._process.stdout),
                (self._read_log, self._process.stderr),
            )
        ]
        for reader in self._readers:
            reader.start()
        # The pipe stays open: its end is how the process learns that legoworld is gone.
        with contextlib.suppress(BrokenPipeError):
            self._process.send(json.dumps(as_json(request)).encode() + b"\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def next_message(self, time_limit_s: float | None) -> Message | Unreadable | None:
        """The next message; None if the process has ended. TooSlowError after the time limit."""
        deadline = None if time_limit_s is None else time.monotonic() + time_limit_s
        while True:
            left = _POLL_S if deadline is None else min(_POLL_S, deadline - time.monotonic())
            try:
                return self._messages.get(timeout=max(left, 0.0))
            except queue.Empty as error:
                if self._process.exit_code() is not None:
                    return self._last_message()
                if deadline is not None and time.monotonic() >= deadline:
                    raise TooSlowError from error

    def _last_message(self) -> Message | Unreadable | None:
        """The last message of an ended process; what held its pipe open ended with it."""
        with contextlib.suppress(queue.Empty):
            return self._messages.get(timeout=_WAIT_FOR_END_S)
        return None

    def how_it_ended(self) -> str:
        """The exit code or signal, and the last line of its log; call it after the end."""
        self._process.exit_code(within_s=_WAIT_FOR_END_S)
        self.close()
        code = self._process.exit_code() or 0
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        return f"{how}; {self.last_words()}"

    def last_words(self) -> str:
        """The last non-empty line of standard error."""
        return one_line(last_line(self._tail), 300)

    def close(self) -> None:
        """End the process and everything it started."""
        self._process.end()
        self._home.close()
        for reader in self._readers:
            reader.join(_WAIT_FOR_END_S)
        if not any(reader.is_alive() for reader in self._readers):
            # A process that left the group would hold a pipe: closing it would wait for it.
            self._process.close()

    def _read_messages(self, stream: IO[bytes]) -> None:
        for line in _lines(stream, _LONGEST_LINE):
            message = read_line(line)
            if message is None and len(line) == _LONGEST_LINE and line.startswith("{"):
                message = Unreadable(
                    image_id=None, reason=f"a line of more than {_LONGEST_LINE >> 20} MiB"
                )
            if message is None:
                self._pass_on(line)
            else:
                self._messages.put(message)
        self._messages.put(None)

    def _read_log(self, stream: IO[bytes]) -> None:
        for line in _lines(stream, _LONGEST_LOG_LINE):
            self._tail.append(line)
            self._pass_on(line)

    def _pass_on(self, line: str) -> None:
        if line.strip():
            self._log(line[:_LONGEST_LOG_LINE].rstrip("\n"))


def _lines(stream: IO[bytes], longest: int) -> Iterator[str]:
    """Lines; one longer than `longest` characters is split into pieces."""
    text = io.TextIOWrapper(stream, encoding="utf-8", errors="replace")
    yield from iter(lambda: text.readline(longest), "")
    text.detach()  # the pipe is closed with the process


def _environment(
    card: BaselineCard, home: Path, declared: Sequence[str], *, offline: bool
) -> dict[str, str]:
    """The process's environment: the shared package alone on its path, no files left behind.

    declared: the caller's variables it may see besides those every model may.
    """
    temporary = home / "temporary"
    temporary.mkdir()
    environment = child_environment(
        ChildKind.MODEL, home=home, temporary=temporary, declared=declared
    )
    environment["PYTHONPATH"] = str(card.shared)
    environment["PYTHONHASHSEED"] = "0"
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    environment["PYTHONUNBUFFERED"] = "1"
    environment.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # cuBLAS repeats itself with it
    environment.setdefault("TOKENIZERS_PARALLELISM", "false")
    if not sys.stderr.isatty():
        environment.setdefault("HF_HUB_DISABLE_PROGRESS_BARS", "1")
    if offline:
        environment |= {"HF_HUB_OFFLINE": "1", "TRANSFORMERS_OFFLINE": "1"}
    return environment
