"""The endpoint's port: clients of Blender MCP's socket protocol, each in a thread of its own."""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import Final, Self

from legoworld.endpoint.framing import FramingError, MessageSplitter
from legoworld.endpoint.listener import Listener
from legoworld.endpoint.session import Session
from legoworld.records.base import RecordError, canonical, decode
from legoworld.records.endpoint import Answer, Caller, Command, Failure

#: Blender MCP's own.
PORT: Final = 9876


class EndpointServer:
    """Listens on a port of this machine alone from its making to its closing.

    port: 0 for any that is free; by: whose calls come through it. A client that vanishes takes
    nothing with it: the call it made comes to its end, and its answer is dropped.
    """

    def __init__(self, session: Session, port: int, by: Caller = "agent") -> None:
        self._session = session
        self._by: Caller = by
        self._clients: set[socket.socket] = set()
        self._owning = threading.Lock()
        self._listener = Listener(port, self._accepted)
        self.port: int = self._listener.port

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Listen no more, and leave the clients. The session stays as it is."""
        self._listener.stop()
        with self._owning:
            for client in self._clients:
                with contextlib.suppress(OSError):
                    client.shutdown(socket.SHUT_RDWR)
        self._listener.join()

    def _accepted(self, client: socket.socket) -> None:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with self._owning:
            self._clients.add(client)
        threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        splitter = MessageSplitter()
        try:
            while data := client.recv(1 << 16):
                for message in splitter.feed(data):
                    _send(client, self._answer(message), splitter)
        except FramingError as error:  # where the next message begins cannot be told
            with contextlib.suppress(OSError):
                _send(client, Failure(message=str(error)), splitter)
        except OSError:
            pass  # the client is gone
        finally:
            with self._owning:
                self._clients.discard(client)
            client.close()

    def _answer(self, message: bytes) -> Answer:
        try:
            command = decode(Command, message)
        except RecordError as error:
            return Failure(message=f'not a command such as {{"type": "get_scene_info"}}: {error}')
        return self._session.answer(command, self._by)


def _send(client: socket.socket, answer: Answer, splitter: MessageSplitter) -> None:
    data = canonical(answer).encode("utf-8", "backslashreplace")
    client.sendall(data + b"\n" if splitter.newlines else data)
