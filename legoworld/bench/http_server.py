"""uvicorn around the scoring service: a port, deadlines, and an end that answers what it took."""

from __future__ import annotations

import asyncio
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import h11
import uvicorn
from starlette.applications import Starlette
from uvicorn.protocols.http.h11_impl import H11Protocol

from legoworld.bench.admission import HttpOptions
from legoworld.bench.http_app import ScoreApp
from legoworld.bench.score_worker import ServeOptions
from legoworld.bench.server import ScoreServer
from legoworld.endpoint.listener import PortTakenError

_HEADERS_S: Final = 10.0
_HEADER_BYTES: Final = 16 << 10
_KEEP_ALIVE_S: Final = 75


def serve_http(
    options: ServeOptions, http: HttpOptions, workers: int, say: Callable[[str], None]
) -> None:
    """Serve until SIGINT or SIGTERM: then accept no client, and answer all that was taken.

    A second SIGINT ends it at once. say: told the address, and why a scoring failed.
    PortTakenError.
    """
    with listening(http.host, http.port) as listener, ScoreServer(options, workers) as server:
        say(f"listening on http://{http.host}:{listener.getsockname()[1]}")
        app = ScoreApp(server, options, http, say)
        http_server(app.asgi(), connections=2 * http.queue + 64).run(sockets=[listener])


def http_server(app: Starlette, *, connections: int) -> uvicorn.Server:
    """A server of the app that is not started yet."""
    config = uvicorn.Config(
        app,
        http=_Protocol,
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_keep_alive=_KEEP_ALIVE_S,
        limit_concurrency=connections,
        h11_max_incomplete_event_size=_HEADER_BYTES,
    )
    return _Server(config)


@contextmanager
def listening(host: str, port: int) -> Iterator[socket.socket]:
    """The socket, until the block ends. PortTakenError."""
    try:
        listener = socket.create_server((host, port), backlog=1024)
    except OSError as error:
        raise PortTakenError(
            f"{host}:{port} cannot be listened on",
            found=error.strerror or str(error),
            expected="an IPv4 address or name of this machine, and a free port",
            next_step="choose another host or port; --port 0 takes any free one",
        ) from error
    with listener:
        yield listener


class _Protocol(H11Protocol):
    """uvicorn's, which waits for a request's headers as long as they trickle."""

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._watch()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        self._watch()

    def _watch(self) -> None:
        waits = self.conn.their_state is h11.IDLE
        if waits and self._late is None:
            self._late = self.loop.call_later(_HEADERS_S, self._end_late)
        elif not waits and self._late is not None:
            self._late.cancel()
            self._late = None

    def _end_late(self) -> None:
        self._late = None
        if self.conn.their_state is h11.IDLE:
            self.transport.close()


class _Server(uvicorn.Server):
    """uvicorn's, which would end the process by the signal it was stopped with."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Have SIGINT and SIGTERM stop the server, and the process go on."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        kinds = (signal.SIGINT, signal.SIGTERM)
        before = {kind: signal.signal(kind, self.handle_exit) for kind in kinds}
        try:
            yield
        finally:
            for kind, handler in before.items():
                signal.signal(kind, handler)
