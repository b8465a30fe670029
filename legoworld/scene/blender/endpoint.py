"""The Blender of an endpoint: requests from a socket, one after the other, on the main thread.

It runs the code of an agent by design, in a sandbox; see `legoworld.endpoint`. The other end of its
socket trusts it only for how the agent's own calls ended.
"""

from __future__ import annotations

import faulthandler
import json
import os
import signal
import socket
import struct
import sys
import time
from typing import Any, Final

from legoworld.records.base import canonical, decode
from legoworld.records.endpoint import BlenderReply, BlenderRequest

_LENGTH: Final = struct.Struct(">I")
#: After the time limit, the agent's code is interrupted anew each time this has passed.
_AGAIN_S: Final = 1.0


class CallTimeoutError(BaseException):
    """Raised in the agent's code when its time is over; no Exception, so that few catch it."""


def main() -> int:
    """Serve the socket in sys.argv[1]; sys.argv[2] is a JSON object: open, become (paths).

    open: the file to begin with, null for Blender's start-up scene; become: where the open scene is
    saved next, null for where it came from.
    """
    faulthandler.enable()
    import bpy

    from legoworld.scene.blender.endpoint_calls import CALLS

    bpy.context.preferences.filepaths.use_scripts_auto_execute = False
    order = json.loads(sys.argv[2])
    if order["open"]:
        bpy.ops.wm.open_mainfile(filepath=order["open"], load_ui=False, use_scripts=False)
    if order["become"]:
        bpy.ops.wm.save_as_mainfile(filepath=order["become"], compress=True, check_existing=False)
    signal.signal(signal.SIGALRM, _time_is_over)
    host = os.getpid()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.connect(sys.argv[1])
        _send(line, BlenderReply(result={"blender": bpy.app.version_string}, seconds=0.0))
        while (data := _receive(line)) is not None:
            request = decode(BlenderRequest, data)
            reply = _reply(CALLS[request.kind], request)
            if os.getpid() != host:  # a fork of the agent's code, which has come to the same end
                os._exit(0)
            _send(line, reply)
    # Some add-ons and caches abort in Blender's own exit code.
    os._exit(0)


def _reply(call: Any, request: BlenderRequest) -> BlenderReply:
    begun = time.perf_counter()
    result, error, stopped = None, None, False
    try:
        signal.setitimer(signal.ITIMER_REAL, request.time_s, _AGAIN_S)
        try:
            result = call(**request.params)
        finally:
            _no_more_alarms()
    except CallTimeoutError:
        error = f"stopped after {request.time_s:g} s; the scene is as the code left it"
        stopped = True
    except MemoryError:
        error = "MemoryError: the scene does not fit into memory"
    except Exception as failure:  # noqa: BLE001  whatever the agent's call does is its answer
        error = str(failure) or type(failure).__name__
    except BaseException as failure:  # noqa: BLE001  SystemExit, or one of the agent's own
        error = f"{type(failure).__name__}: {failure}"
    seconds = time.perf_counter() - begun
    return BlenderReply(result=result, error=error, stopped=stopped, seconds=seconds)


def _time_is_over(_number: int, _frame: object) -> None:
    raise CallTimeoutError


def _no_more_alarms() -> None:
    """Stop the timer; the agent's code, which is untrusted, may have removed the handler."""
    while True:
        try:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, _time_is_over)
            return
        except CallTimeoutError:
            continue


def _receive(line: socket.socket) -> bytes | None:
    """The next message; None when the endpoint is gone."""
    head = _exactly(line, _LENGTH.size)
    return None if head is None else _exactly(line, _LENGTH.unpack(head)[0])


def _exactly(line: socket.socket, size: int) -> bytes | None:
    parts, left = [], size
    while left:
        data = line.recv(min(left, 1 << 20))
        if not data:
            return None
        parts.append(data)
        left -= len(data)
    return b"".join(parts)


def _send(line: socket.socket, reply: BlenderReply) -> None:
    try:
        data = canonical(reply).encode()
    except (TypeError, ValueError, RecursionError) as error:
        reply = BlenderReply(error=f"the answer is not JSON: {error}", seconds=reply.seconds)
        data = canonical(reply).encode("utf-8", "replace")
    line.sendall(_LENGTH.pack(len(data)) + data)


if __name__ == "__main__":
    sys.exit(main())
