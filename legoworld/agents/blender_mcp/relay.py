"""Standard input and output of an MCP client to a server that listens on a port of this machine.

Started by an agent in the place of the plugin's server, which runs outside of the agent's sandbox:
what it keeps and the limits it holds an agent to are out of that agent's reach. It imports nothing
of legoworld.
"""

from __future__ import annotations

import os
import socket
import sys
import threading


def main() -> int:
    """relay.py HOST PORT; ends when the server has said its last."""
    with socket.create_connection((sys.argv[1], int(sys.argv[2]))) as line:
        threading.Thread(target=_forward, args=(line,), daemon=True).start()
        while data := line.recv(1 << 16):
            _write(data)
    return 0


def _forward(line: socket.socket) -> None:
    while data := os.read(0, 1 << 16):
        line.sendall(data)
    line.shutdown(socket.SHUT_WR)


def _write(data: bytes) -> None:
    while data:
        data = data[os.write(1, data) :]


if __name__ == "__main__":
    sys.exit(main())
