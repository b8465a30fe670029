"""A baseline's process: started with one request, read line by line, ended with its group."""

from __future__ import annotations

import contextlib
import io
import json
import math
import queue
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePath
from typing import IO, Final, Self

from msgspec.structs import replace

from legoworld import exit_codes
from legoworld.baselines.answers import Unreadable, read_line
from legoworld.baselines.cards import BaselineCard
from legoworld.baselines.confinement import BaselineConfinement, readable, writable
from legoworld.beneath import Beneath
from legoworld.errors import LegoWorldError, Raised, one_line
from legoworld.files import Json
from legoworld.records.base import as_json
from legoworld.records.baseline_messages import ChildRequest, Message
from legoworld.records.folders.run_folder import BASELINE_SCRATCH
from legoworld.workers.child_process import last_line
from legoworld.workers.environment import ChildKind, child_environment
from legoworld.workers.sandbox import SandboxLimits
from legoworld.workers.scratch import ScratchFolder
from legoworld.workers.talking_sandbox import TalkingSandbox

_KEPT_LOG_LINES: Final = 60
#: Messages that are read ahead.
_MOST_WAITING: Final = 64
#: Nothing but the size of a file is limited, and that only where it is no size.
_LIMITS: Final = SandboxLimits(time_s=math.inf, memory_bytes=1 << 62, disk_bytes=1 << 62)
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
    """One process of a baseline, in the sandbox of scene programs.

    variables: names of the caller's variables that it gets besides those every model gets. output:
    the folder that `take` brings its files to; what it writes itself lies in a folder of its own
    in there. Lines on its standard output that are no messages, and its standard error, are its
    log and go to `log`; the last lines of standard error are kept for `last_words`.
    """

    def __init__(
        self,
        card: BaselineCard,
        python: Path,
        request: ChildRequest,
        log: Callable[[str], None],
        *,
        output: Path,
        confinement: BaselineConfinement,
        variables: Sequence[str] = (),
    ) -> None:
        self._log = log
        self._output = output
        self._home = ScratchFolder(BASELINE_SCRATCH, output)
        self._tail: deque[str] = deque(maxlen=_KEPT_LOG_LINES)
        self._messages: queue.Queue[Message | Unreadable | None] = queue.Queue(_MOST_WAITING)
        self._unsent: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._closing = False
        self._sandbox = TalkingSandbox(
            self._home.path, _LIMITS, confinement.protections, owner=self._home.path,
            lease=self._home.owner_fd,
        )  # fmt: skip
        try:
            environment = _environment(card, self._sandbox, confinement, variables, request)
            shown = readable(card, python, request, environment, confinement.inputs)
            self._pipes = self._sandbox.converse(
                [str(python), str(card.program)],
                environment,
                read_only=shown,
                writable=writable(environment) if confinement.protections.network else (),
            )
        except BaseException:
            self._sandbox.close()
            self._home.close()
            raise
        self._threads = [
            threading.Thread(target=target, daemon=True)
            for target in (self._read_messages, self._read_log, self._write)
        ]
        for thread in self._threads:
            thread.start()
        seen = replace(request, output=str(self._sandbox.path_inside("output")))
        self._send(as_json(seen))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        self.close()

    def begin(self) -> None:
        """Let it predict: it has loaded its model, and the results of an earlier run are gone."""
        self._send({"begin": True})

    def next_message(self, deadline: float | None) -> Message | Unreadable | None:
        """The next message; None if the process has ended.

        deadline: in time.monotonic() seconds, None for none. TooSlowError when it has passed and no
        message is waiting.
        """
        while True:
            left = _POLL_S if deadline is None else min(_POLL_S, deadline - time.monotonic())
            try:
                return self._messages.get(timeout=max(left, 0.0))
            except queue.Empty as error:
                if self._sandbox.poll_exit() is not None:
                    return self._last_message()
                if deadline is not None and time.monotonic() >= deadline:
                    raise TooSlowError from error

    def take(self, name: str) -> bool:
        """Bring a file that it wrote to the output folder, in place of an earlier one.

        name: relative, in both. False where it wrote none; RefusedFileError for a link, say. What
        it still holds open can change: read, and hash, what was taken.
        """
        target, wrote = self._output / name, PurePath("output", name)
        with Beneath(self._home.path) as files:
            if files.status(wrote) is None:  # refuses what leads out, before a folder is made
                return False
            target.parent.mkdir(parents=True, exist_ok=True)
            return files.move_out(wrote, target)

    def _last_message(self) -> Message | Unreadable | None:
        """The last message of an ended process; what held its pipe open ended with it."""
        with contextlib.suppress(queue.Empty):
            return self._messages.get(timeout=_WAIT_FOR_END_S)
        return None

    def how_it_ended(self) -> str:
        """The exit code or signal, and the last line of its log; call it after the end."""
        code = self._sandbox.poll_exit(within_s=_WAIT_FOR_END_S) or 0
        self.close()
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        return f"{how}; {self.last_words()}"

    def last_words(self) -> str:
        """The last non-empty line of standard error."""
        return one_line(last_line(self._tail), 300)

    def close(self) -> None:
        """End the process and everything it started."""
        self._closing = True
        self._sandbox.close()
        self._unsent.put(None)
        for thread in self._threads:
            thread.join(_WAIT_FOR_END_S)
        if not any(thread.is_alive() for thread in self._threads):
            # A process that left the sandbox would hold a pipe: closing it would wait for it.
            for pipe in (self._pipes.stdin, self._pipes.stdout, self._pipes.stderr):
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
        self._home.close()

    def _send(self, line: Json) -> None:
        self._unsent.put(json.dumps(line).encode() + b"\n")

    def _write(self) -> None:
        """Send what is to be sent. The pipe stays open: its end is that of legoworld."""
        with contextlib.suppress(BrokenPipeError):
            while (data := self._unsent.get()) is not None:
                self._pipes.stdin.write(data)
                self._pipes.stdin.flush()

    def _read_messages(self) -> None:
        for line in _lines(self._pipes.stdout, _LONGEST_LINE):
            message = _read_answer(line)
            if message is None and len(line) == _LONGEST_LINE and line.startswith("{"):
                message = Unreadable(
                    image_id=None, reason=f"a line of more than {_LONGEST_LINE >> 20} MiB"
                )
            if message is None:
                self._pass_on(line)
            else:
                self._hand_over(message)
        self._hand_over(None)

    def _hand_over(self, message: Message | Unreadable | None) -> None:
        """Wait until there is room for a message: one that only sends fills no memory."""
        while not self._closing:
            with contextlib.suppress(queue.Full):
                self._messages.put(message, timeout=_POLL_S)
                return

    def _read_log(self) -> None:
        for line in _lines(self._pipes.stderr, _LONGEST_LOG_LINE):
            self._tail.append(line)
            self._pass_on(line)

    def _pass_on(self, line: str) -> None:
        if line.strip():
            self._log(line[:_LONGEST_LOG_LINE].rstrip("\n"))


def _read_answer(line: str) -> Message | Unreadable | None:
    """`read_line`; whatever it meets, the thread that reads goes on."""
    try:
        return read_line(line)
    except Exception as error:  # noqa: BLE001  it is the image's reason, and in the log
        return Unreadable(image_id=None, reason=one_line(f"{type(error).__name__}: {error}", 200))


def _lines(stream: IO[bytes], longest: int) -> Iterator[str]:
    """Lines; one longer than `longest` characters is split into pieces."""
    text = io.TextIOWrapper(stream, encoding="utf-8", errors="replace")
    yield from iter(lambda: text.readline(longest), "")
    text.detach()  # the pipe is closed with the process


def _environment(
    card: BaselineCard,
    sandbox: TalkingSandbox,
    confinement: BaselineConfinement,
    variables: Sequence[str],
    request: ChildRequest,
) -> dict[str, str]:
    """The process's environment: the shared package alone on its path, no files left behind.

    variables: the caller's variables it may see besides those every model may.
    """
    home = sandbox.path_inside("home")
    environment = child_environment(
        ChildKind.MODEL, home=home, temporary=sandbox.temporary, variables=variables
    )
    environment["PYTHONPATH"] = str(card.shared_path)
    environment["PYTHONHASHSEED"] = "0"
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    environment["PYTHONUNBUFFERED"] = "1"
    environment.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # cuBLAS repeats itself with it
    environment.setdefault("TOKENIZERS_PARALLELISM", "false")
    if not sys.stderr.isatty():
        environment.setdefault("HF_HUB_DISABLE_PROGRESS_BARS", "1")
    bubblewrap = confinement.protections.bubblewrap is not None
    if request.offline or (bubblewrap and not confinement.protections.network):
        environment |= {"HF_HUB_OFFLINE": "1", "TRANSFORMERS_OFFLINE": "1"}
    if bubblewrap:
        # The caller's compiled kernels are run by the caller's other programs: it has its own.
        environment |= {"TRITON_CACHE_DIR": f"{home}/triton", "CUDA_CACHE_PATH": f"{home}/cuda"}
        environment["USER"] = "baseline"  # torch asks for the name, and there is no /etc/passwd
    return environment
