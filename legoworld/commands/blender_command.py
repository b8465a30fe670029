"""`legoworld blender`."""

from __future__ import annotations

import contextlib
import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output, print_json
from legoworld.commands.param_types import AMOUNT, EXISTING_FILE, EXISTING_FOLDER

if TYPE_CHECKING:
    from legoworld.workers.protections import Protections

_MEMORY: Final = options.memory_bytes("Blender and what it starts")
_DAY_S = 86_400.0


@options.group("blender")
def command() -> None:
    """A headless Blender that coding agents drive.

    \b
    Examples:
      legoworld blender serve
      legoworld blender mcp --workspace work
      legoworld blender finalise work -o scene
      legoworld blender serve room.blend --port 9900
    """


@command.command("serve")
@click.argument("scene", type=EXISTING_FILE, required=False)
@option(
    "--port",
    "TCP port on 127.0.0.1; 0 for any that is free.",
    click.IntRange(0, 65535),
    default=9876,
)
@option("--workspace", "The only folder Blender can write to [default: blender-PORT].")
@option("--input", "File or folder Blender may read; repeatable.")
@options.protections(flag("--network", "Let the code it runs use the network."))
@option("--time-limit", "Seconds until the endpoint ends.", default=14400.0)
@option(
    "--call-time-limit call_time_s",
    "Seconds one call may take; mcp-for-blender gives up after 180.",
    AMOUNT,
    default=165.0,
)
@_MEMORY
@options.quiet("Print the port and nothing else.")
def serve(time_limit_s: float, memory_bytes: int, out: Output, **given: Any) -> int:
    """Run a Blender that speaks Blender MCP's socket protocol, without a display.

    It runs whatever Python code its clients send. With bubblewrap that code has no network, writes
    only to the workspace, and reads none of your files but SCENE and each --input; it never gets
    your environment variables. A call that crashes Blender or does not end gets an error;
    Blender then restarts with the scene as the last call left it.

    The scene after each call that changed it is kept in WORKSPACE.trajectory. Run the same command
    again to continue from the last one. Ctrl-C ends it.

    \b
    Examples:
      legoworld blender serve
      legoworld blender serve room.blend --port 9900 --workspace room-work
      BLENDER_PORT=9900 DISABLE_TELEMETRY=1 mcp-for-blender
    """
    from legoworld.endpoint.serve import EndpointOptions, serve_endpoint
    from legoworld.workers.sandbox import SandboxLimits

    over = threading.Event()
    signal.signal(signal.SIGTERM, lambda _number, _frame: over.set())
    limits = SandboxLimits(time_s=time_limit_s, memory_bytes=memory_bytes)
    serving = EndpointOptions(limits=limits, **given)
    with contextlib.suppress(KeyboardInterrupt):
        serve_endpoint(serving, over, say=click.echo, notice=out.notice)
    return 0


@command.command("mcp")
@option("--workspace", "The only folder Blender can write to.", required=True)
@options.protections()
@_MEMORY
@options.quiet("Print no notices on standard error.")
def mcp(workspace: Path, protections: Protections, memory_bytes: int, out: Output) -> int:
    """Be an MCP server on standard input and output: mcp-for-blender over an endpoint of its own.

    For an agent's MCP configuration: the one command is all that it has to start. What `blender
    serve` says of the code it runs holds here. It ends with standard input; started again, it
    continues with the last scene. Needs `legoworld agent install`.

    \b
    Examples:
      legoworld blender mcp --workspace work
      legoworld blender mcp --workspace work --memory-limit 4
      claude mcp add blender -- legoworld blender mcp --workspace work
    """
    from legoworld.agents.mcp_endpoint import serve_mcp
    from legoworld.endpoint.serve import EndpointOptions
    from legoworld.endpoint.session import CALL_TIME_S
    from legoworld.workers.sandbox import SandboxLimits

    serving = EndpointOptions(
        scene=None,
        port=0,
        workspace=workspace,
        inputs=(),
        protections=protections,
        limits=SandboxLimits(time_s=_DAY_S, memory_bytes=memory_bytes),
        call_time_s=CALL_TIME_S,
    )
    return serve_mcp(serving, notice=out.notice)


@command.command("finalise")
@click.argument("workspace", type=EXISTING_FOLDER)
@option("--output", "The scene folder to be.")
@option("--sandbox")
@option("--memory-limit", "Memory limit of Blender and what it starts, in GiB.")
@options.printing
def finalise(workspace: Path, output: Path, out: Output, **given: Any) -> int:
    """Export the submission of WORKSPACE, the way `legoworld reconstruct` does for every agent.

    That is the scene.blend that was saved last, and where there is none, or none that opens, the
    scene as the last call left it (WORKSPACE.trajectory). Its scene.blend, scene.glb and final.png
    are exported anew. Exit code 1 where there is no scene.

    \b
    Examples:
      legoworld blender finalise work -o scenes/coffee
      legoworld blender finalise work -o scenes/coffee --json
    """
    from legoworld.endpoint.workspace_finalisation import blender_finalise

    found = blender_finalise(workspace, output, **given)
    if out.as_json:
        print_json({"finalisation": found})
    elif found.source == "none":
        click.echo(f"no scene could be exported: {'; '.join(found.refused) or 'none'}", err=True)
    else:
        click.echo(f"the {found.source} scene -> {output}")
    return 1 if found.source == "none" else 0
