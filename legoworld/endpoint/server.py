"""The endpoint's port: clients of Blender MCP's socket protocol, each in a thread of its own."""

from __future__ import annotations

import contextlib
import socket
import threading
import traceback
from typing import Final, Self

from legoworld.endpoint.listener import Listener
from legoworld.endpoint.message_frames import FramingError, MessageSplitter
from legoworld.endpoint.session import Session
from legoworld.errors import Raised, one_line
from legoworld.records.base import RecordError, canonical, decode
from legoworld.records.endpoint import Answer, Caller, Command, Failure

#: Blender MCP's own.
PORT: Final = 9876
#: Each has a thread and a descriptor; the session answers one command at a time anyway.
MOST_CLIENTS: Final = 64
#: How long the words of a client that is refused are waited for, so that it reads the answer.
_REFUSED_WITHIN_S: Final = 0.2


class EndpointServer:
    """Listens on a local port until it is closed.

    port: 0 for a free one; by: the caller recorded for its calls. Every command gets one answer,
    valid or not. If a client disconnects, its call completes and the answer is dropped. Clients
    beyond MOST_CLIENTS are refused with a message.
    """

    def __init__(self, session: Session, port: int, by: Caller = "agent") -> None:
        self._session = session
        self._by: Caller = by
        self._clients: set[socket.socket] = set()
        self._owning = threading.Lock()
        self._listener = Listener(port, self._admit_client)
        self.port: int = self._listener.port

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        self.close()

    def close(self) -> None:
        """Listen no more, and leave the clients. The session stays as it is."""
        self._listener.stop()
        with self._owning:
            for client in self._clients:
                with contextlib.suppress(OSError):
                    client.shutdown(socket.SHUT_RDWR)
        self._listener.join()

    def _admit_client(self, client: socket.socket) -> None:
        with self._owning:
            room = len(self._clients) < MOST_CLIENTS
            if room:
                self._clients.add(client)
        if not room:
            _refuse(client)
            return
        try:
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()
        except BaseException:
            self._drop_client(client)
            raise

    def _drop_client(self, client: socket.socket) -> None:
        with self._owning:
            self._clients.discard(client)
        client.close()

    def _serve(self, client: socket.socket) -> None:
        splitter = MessageSplitter()
        try:
            while data := client.recv(1 << 16):
                for message in splitter.feed(data):
                    client.sendall(_frame_answer(self._answer(message), splitter))
        except FramingError as error:  # the start of the next message is unknown
            with contextlib.suppress(OSError):
                client.sendall(_frame_answer(_encode_answer(Failure(message=str(error))), splitter))
        except OSError:
            pass  # the client is gone
        finally:
            self._drop_client(client)

    def _answer(self, message: bytes) -> bytes:
        try:
            return _encode_answer(self._answer_message(message))
        except Exception as error:  # noqa: BLE001  a mistake of ours is an answer, too
            traceback.print_exc()
            said = one_line(f"{type(error).__name__}: {error}")
            return _encode_answer(
                Failure(message=f"internal error, not caused by the command: {said}")
            )

    def _answer_message(self, message: bytes) -> Answer:
        try:
            command = decode(Command, message)
        except RecordError as error:
            return Failure(message=f'not a command such as {{"type": "get_scene_info"}}: {error}')
        return self._session.answer(command, self._by)


def _encode_answer(answer: Answer) -> bytes:
    return canonical(answer).encode("utf-8", "backslashreplace")


def _frame_answer(data: bytes, splitter: MessageSplitter) -> bytes:
    return data + b"\n" if splitter.newlines else data


def _refuse(client: socket.socket) -> None:
    """Refuse a client over the limit, after its first bytes: before, it may not read the answer."""
    with client, contextlib.suppress(OSError):
        client.settimeout(_REFUSED_WITHIN_S)
        with contextlib.suppress(TimeoutError):
            client.recv(1 << 16)
        client.sendall(
            _encode_answer(Failure(message=f"{MOST_CLIENTS} clients are connected already"))
        )
