"""A port of this machine alone, listened on in a thread from its making to its closing."""

from __future__ import annotations

import contextlib
import socket
import threading
import traceback
from collections.abc import Callable
from typing import Final

from legoworld import exit_codes
from legoworld.errors import LegoWorldError

HOST: Final = "127.0.0.1"
_AGAIN_S: Final = 0.05


class PortTakenError(LegoWorldError):
    """The port cannot be listened on."""

    code = "port_taken"
    exit_code = exit_codes.BLOCKED


class Listener:
    """Hands each client to `accepted`, one after the other, which owns it unless it raises.

    It ends with `stop` alone: while the machine has no descriptor or thread left, clients wait or
    are closed, and errors of `accepted` are printed. port: 0 for any that is free. PortTakenError
    where it cannot be used.
    """

    def __init__(self, port: int, accepted: Callable[[socket.socket], None]) -> None:
        self._on_client = accepted
        self._over = threading.Event()
        try:
            self._socket = socket.create_server((HOST, port))
        except OSError as error:
            raise PortTakenError(
                f"port {port} cannot be used",
                found=error.strerror or str(error),
                expected="a free port",
                next_step="pass another --port, or 0 for any",
            ) from error
        self.port: int = self._socket.getsockname()[1]
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Accept no more clients; `join` waits for the one that is being handed over."""
        self._over.set()
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def join(self) -> None:
        """Wait until nothing is handed over any more."""
        self._thread.join()

    def _accept(self) -> None:
        while not self._over.is_set():
            try:
                client, _ = self._socket.accept()
            except OSError:  # stopped; or a client that left, or no descriptor is free
                self._over.wait(_AGAIN_S)
                continue
            try:
                self._on_client(client)
            except Exception:  # noqa: BLE001  such as no free thread: the next client is another
                traceback.print_exc()
                client.close()
