"""`legoworld blender mcp`: mcp-for-blender on standard input and output, over its own endpoint."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

from legoworld.agents.mcp_server import blender_server
from legoworld.endpoint.serve import EndpointOptions, open_endpoint, workspace_path
from legoworld.workers.environment import blender_environment


def serve_mcp(serving: EndpointOptions, *, notice: Callable[[str], None]) -> int:
    """Serve until standard input ends; the server's exit code. Raises UsageError without one."""
    with open_endpoint(serving, notice=notice) as port:
        temporary = workspace_path(serving).resolve() / "tmp"
        temporary.mkdir(exist_ok=True)
        environment = blender_environment(home=temporary, temporary=temporary)
        server = blender_server(port, temporary)
        done = subprocess.run(
            [server.command, *server.arguments],
            env={**environment, **server.variables},
            check=False,
        )
    return done.returncode
