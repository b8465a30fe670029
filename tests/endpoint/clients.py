"""A client of Blender MCP's socket protocol, as simple as the add-on's own."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from legoworld.endpoint.listener import HOST
from legoworld.endpoint.server import EndpointServer
from legoworld.endpoint.session import Session, Trial
from legoworld.workers.protections import Confinement, protections
from legoworld.workers.sandbox import SandboxLimits

LIMITS = SandboxLimits(time_s=600.0, memory_bytes=3 << 30, disk_bytes=200 << 20, processes=64)


class Client:
    """Sends a command as bytes and waits until what comes back is JSON."""

    def __init__(self, port: int) -> None:
        self.line = socket.create_connection((HOST, port), timeout=600)

    def receive(self) -> Any:
        data = b""
        while True:
            part = self.line.recv(8192)
            assert part, f"closed after {data[:200]!r}"
            data += part
            try:
                return json.loads(data)
            except ValueError:
                continue

    def ask(self, kind: str, **params: Any) -> Any:
        self.line.sendall(json.dumps({"type": kind, "params": params}).encode())
        return self.receive()

    def run(self, code: str) -> str:
        """What code prints; AssertionError with the message where it fails."""
        answer = self.ask("execute_code", code=code)
        assert answer["status"] == "success", answer["message"]
        printed = answer["result"]["result"]
        assert isinstance(printed, str)
        return printed

    def refused(self, code: str) -> str:
        """The message of code that fails."""
        answer = self.ask("execute_code", code=code)
        assert answer["status"] == "error", answer
        message = answer["message"]
        assert isinstance(message, str)
        return message


class ServedSession:
    """A served session: its port, its folders, its record."""

    def __init__(self, folder: Path, session: Session, server: EndpointServer) -> None:
        self.workspace = folder / "workspace"
        self.session = session
        self.server = server
        self._clients: list[Client] = []

    def client(self) -> Client:
        """A client, whose line is closed with the endpoint."""
        self._clients.append(Client(self.server.port))
        return self._clients[-1]

    def close(self) -> None:
        for client in self._clients:
            client.line.close()


@contextmanager
def serve_session(
    folder: Path,
    *,
    limits: SandboxLimits = LIMITS,
    confinement: Confinement = "auto",
    network: bool = False,
    call_time_s: float = 300.0,
    blend: Path | None = None,
) -> Iterator[ServedSession]:
    """An endpoint on a free port."""
    (folder / "workspace").mkdir(exist_ok=True, parents=True)
    session = Session(
        Trial(
            workspace=folder / "workspace",
            record=folder / "record",
            limits=limits,
            protections=protections(confinement, network=network),
            call_time_s=call_time_s,
            blend=blend,
        )
    )
    with (
        closing(session),
        EndpointServer(session, 0) as server,
        closing(ServedSession(folder, session, server)) as found,
    ):
        yield found
