"""An endpoint's Blender: in a sandbox, asked over a socket, and ended at a limit or in a crash."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, Self, TypeVar

from legoworld.errors import LegoWorldError, Raised, one_line
from legoworld.files import Json
from legoworld.records.base import RecordError, canonical, decode
from legoworld.records.endpoint import BlenderReply, BlenderRequest
from legoworld.scene.folder import BLEND
from legoworld.scene.programs.verdicts import signal_name
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import Ending, Limit, Sandbox, SandboxLimits
from legoworld.workers.scratch import ScratchFolder

_LENGTH: Final = struct.Struct(">I")
_LARGEST_REPLY: Final = 64 << 20
#: Code that does not stop when it is interrupted is ended with its Blender this much later.
_GRACE_S: Final = 10.0
_START_WITHIN_S: Final = 120.0
_CHANNEL: Final = "channel"
_Made = TypeVar("_Made")


class BlenderEndedError(LegoWorldError):
    """The endpoint's Blender ended while it had a request.

    limit: the one it was ended for, None where it crashed or ended itself; killed: by a SIGKILL,
    which is the system's, out of memory, or comes from outside.
    """

    code = "blender_ended"

    def __init__(
        self, what: str, *, found: str = "", limit: Limit | None = None, killed: bool = False
    ) -> None:
        super().__init__(what, found=found)
        self.limit, self.killed = limit, killed


def again_if_killed(make: Callable[[], _Made]) -> _Made:
    """Once more where its Blender was killed, which tells nothing of the scene that it opened."""
    try:
        return make()
    except BlenderEndedError as error:
        if not error.killed:
            raise
    return make()


class LiveBlender:
    """One Blender process from its start to its end.

    workspace: the folder it can write to under its own name. blend: the file it opens, None for
    Blender's start-up scene; one from outside of the workspace becomes `workspace/scene.blend`, so
    that the original is never written. lease: see `Sandbox`. Requests come from one thread at a
    time.
    """

    def __init__(
        self,
        workspace: Path,
        limits: SandboxLimits,
        protections: Protections,
        *,
        blend: Path | None = None,
        inputs: Sequence[Path] = (),
        lease: int | None = None,
    ) -> None:
        self._limits = limits
        self._folder = ScratchFolder("legoworld-endpoint-")
        scratch = self._folder.path / "sandbox"
        scratch.mkdir()
        self._sandbox = Sandbox(
            scratch, limits, protections, owner=self._folder.path, workspace=workspace, lease=lease
        )
        self._ending: Ending | None = None
        self._watch: threading.Thread | None = None
        self._line: socket.socket | None = None
        try:
            self._start(workspace.resolve(), blend, inputs)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        self.close()

    @property
    def files(self) -> Path:
        """The folder of the files named by `left`; Blender can write anywhere in it."""
        return self._sandbox.scratch

    @staticmethod
    def output_name(name: str) -> str:
        """The name below `files` of a file that Blender leaves for the endpoint."""
        return f"output/{name}"

    def path_inside(self, name: str) -> str:
        """The same file as Blender sees it."""
        return str(self._sandbox.path_inside("output") / name)

    def ask(self, kind: str, params: Mapping[str, Json], time_s: float) -> BlenderReply:
        """Blender's reply. BlenderEndedError if there is none; this Blender has then ended."""
        request = BlenderRequest(kind=kind, params=dict(params), time_s=time_s)
        data = canonical(request).encode("utf-8", "surrogatepass")
        assert self._line is not None
        try:
            self._line.settimeout(time_s + _GRACE_S)
            self._line.sendall(_LENGTH.pack(len(data)) + data)
            return self._reply(time.monotonic() + time_s + _GRACE_S)
        except (OSError, RecordError) as error:
            raise self._end_and_explain(error, time_s) from error

    def close(self) -> None:
        """End Blender with everything it started."""
        if self._line is not None:
            self._line.close()
            self._line = None
        self._sandbox.stop()
        if self._watch is not None:
            self._watch.join()
        self._sandbox.close()
        self._folder.close()

    def _start(self, workspace: Path, blend: Path | None, inputs: Sequence[Path]) -> None:
        shown = [path.resolve() for path in inputs]
        opened = None if blend is None else blend.resolve()
        foreign = opened is not None and not opened.is_relative_to(workspace)
        order = json.dumps(
            {
                "open": None if opened is None else str(opened),
                "become": str(workspace / BLEND) if foreign else None,
            }
        )
        with _open_socket(self._sandbox.scratch) as listener:
            self._sandbox.start(
                [
                    *(sys.executable, "-u", "-m", "legoworld.scene.blender.endpoint"),
                    *(str(self._sandbox.path_inside(_CHANNEL)), order),
                ],
                [*shown, *([opened] if opened and foreign else [])],
            )
            self._watch = threading.Thread(target=self._wait_for_end, daemon=True)
            self._watch.start()
            self._line = self._accept_connection(listener)
        try:
            self._line.settimeout(_START_WITHIN_S)
            self._reply(time.monotonic() + _START_WITHIN_S)
        except (OSError, RecordError) as error:
            raise self._end_and_explain(error, _START_WITHIN_S) from error

    def _accept_connection(self, listener: socket.socket) -> socket.socket:
        deadline = time.monotonic() + _START_WITHIN_S
        with selectors.DefaultSelector() as selector:
            selector.register(listener, selectors.EVENT_READ)
            while not selector.select(0.05):
                if self._ending is not None or time.monotonic() > deadline:
                    raise self._end_and_explain(TimeoutError(), _START_WITHIN_S)
        return listener.accept()[0]

    def _wait_for_end(self) -> None:
        self._ending = self._sandbox.wait()

    def _reply(self, deadline: float) -> BlenderReply:
        size = _LENGTH.unpack(self._exactly(_LENGTH.size, deadline))[0]
        if size > _LARGEST_REPLY:
            raise ConnectionError(f"a reply of {size:,} bytes")
        return decode(BlenderReply, self._exactly(size, deadline))

    def _exactly(self, size: int, deadline: float) -> bytes:
        assert self._line is not None
        data = bytearray()
        while len(data) < size:
            self._line.settimeout(max(deadline - time.monotonic(), 0.001))
            part = self._line.recv(min(size - len(data), 1 << 20))
            if not part:
                raise ConnectionError("its end of the line is closed")
            data += part
        return bytes(data)

    def _end_and_explain(self, error: Exception, time_s: float) -> BlenderEndedError:
        """End this Blender and explain why there is no reply."""
        if isinstance(error, TimeoutError) and self._ending is None:
            self.close()
            return BlenderEndedError(
                f"Blender was ended: still busy {_GRACE_S:g} s after its {time_s:g} s were over",
                limit="time",
            )
        if self._watch is not None:
            self._watch.join(_GRACE_S)  # the line closes a little before its end is known
        ending = self._ending
        self.close()
        if ending is None:
            return BlenderEndedError("Blender closed its line", found=str(error))
        if ending.over is not None:
            return BlenderEndedError(_over_limit(ending.over, self._limits), limit=ending.over)
        code = ending.code or 0
        how = signal_name(-code) if code < 0 else f"exit code {code}"
        last = [line for line in ending.last_output.splitlines() if line.strip()]
        said = one_line(last[-1], 150) if last and code >= 0 else ""
        killed = code == -signal.SIGKILL
        return BlenderEndedError(f"Blender crashed or was ended: {how}", found=said, killed=killed)


def _over_limit(limit: Limit, limits: SandboxLimits) -> str:
    return {
        "time": "the trial's time is over, and Blender was ended",
        "memory": f"Blender used more than {limits.memory_bytes / 2**30:g} GiB and was ended",
        "disk": f"more than {limits.disk_bytes / 2**30:g} GiB were written, and Blender was ended",
        "output": f"more than {limits.output_bytes >> 20} MiB were printed, and Blender was ended",
        "processes": f"more than {limits.processes} processes ran, and all were ended",
    }[limit]


@contextlib.contextmanager
def _open_socket(folder: Path) -> Iterator[socket.socket]:
    """A socket in a folder, whatever the length of its path."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
            listener.bind(f"/proc/self/fd/{descriptor}/{_CHANNEL}")
            listener.listen(1)
            yield listener
    finally:
        os.close(descriptor)
