"""The plugin's server of one trial, outside of the agent's sandbox, reached through a port."""

from __future__ import annotations

import socket
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Self

from legoworld.endpoint.listener import Listener
from legoworld.errors import Raised

_END_WITHIN_S: Final = 30.0


class PluginHost:
    """Starts `command` for each client that connects, with the connection as its standard streams.

    One client after the other: a ledger has one writer. log: where the servers' errors go.
    """

    def __init__(self, command: Sequence[str], log: Path) -> None:
        self._command, self._log = list(command), log
        self._running: subprocess.Popen[bytes] | None = None
        self._closing = False
        self._owning = threading.Lock()
        self._listener = Listener(0, self._serve_client)
        self.port: int = self._listener.port

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        self.close()

    def close(self) -> None:
        """Listen no more, and wait for the server: its client is gone, so it ends by itself."""
        self._listener.stop()
        with self._owning:
            self._closing = True
            running = self._running
        if running is not None:
            try:
                running.wait(_END_WITHIN_S)
            except subprocess.TimeoutExpired:
                running.kill()
        self._listener.join()

    def _serve_client(self, client: socket.socket) -> None:
        with client, self._log.open("ab") as errors, self._owning:
            if self._closing:
                return
            self._running = subprocess.Popen(
                self._command, stdin=client.fileno(), stdout=client.fileno(), stderr=errors
            )
        self._running.wait()
