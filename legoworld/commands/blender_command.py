"""`legoworld blender`."""

from __future__ import annotations

import contextlib
import signal
import threading
from pathlib import Path
from typing import Literal

import click

from legoworld.commands import options

_CONTEXT = {"help_option_names": ["-h", "--help"]}
_SANDBOX = click.option(
    "--sandbox", type=options.Choice(["auto", "bubblewrap", "limits"]), default="auto",
    show_default=True,
    help="auto: bubblewrap where it works, otherwise resource limits only; "
    "bubblewrap: fail if unavailable.",
)  # fmt: skip
_MEMORY = click.option(
    "--memory-limit", default=8.0, show_default=True, type=click.FloatRange(min=0.1),
    help="GiB Blender and what it starts may use together.",
)  # fmt: skip
_DAY_S = 86_400.0
_FINALISE_S = 600.0


@click.group("blender", context_settings=_CONTEXT)
def command() -> None:
    """A headless Blender that coding agents drive.

    \b
    Examples:
      legoworld blender serve
      legoworld blender mcp --workspace work
      legoworld blender finalise work -o scene
      legoworld blender serve room.blend --port 9900
    """


@command.command("serve", context_settings=_CONTEXT)
@click.argument("scene", type=options.EXISTING_FILE, required=False)
@click.option(
    "--port", default=9876, show_default=True, type=click.IntRange(0, 65535),
    help="TCP port on 127.0.0.1; 0 for any that is free.",
)  # fmt: skip
@click.option(
    "--workspace", type=options.FOLDER,
    help="The only folder Blender can write to [default: blender-PORT].",
)  # fmt: skip
@click.option(
    "--input", "inputs", multiple=True, type=click.Path(path_type=Path, exists=True),
    help="A file or folder Blender may read; repeat.",
)  # fmt: skip
@click.option("--network", is_flag=True, help="Let the code it runs use the network.")
@_SANDBOX
@click.option(
    "--time-limit", default=14400.0, show_default=True, type=click.FloatRange(min=0.1),
    help="Seconds until the endpoint ends.",
)  # fmt: skip
@click.option(
    "--call-time-limit", default=165.0, show_default=True, type=click.FloatRange(min=0.1),
    help="Seconds one call may take; mcp-for-blender gives up after 180.",
)  # fmt: skip
@_MEMORY
@click.option("-q", "--quiet", is_flag=True, help="Print the port and nothing else.")
def serve(
    scene: Path | None,
    port: int,
    workspace: Path | None,
    inputs: tuple[Path, ...],
    network: bool,
    sandbox: Literal["auto", "bubblewrap", "limits"],
    time_limit: float,
    call_time_limit: float,
    memory_limit: float,
    quiet: bool,
) -> int:
    """Run a Blender that speaks Blender MCP's socket protocol, without a display.

    It runs whatever Python code its clients send. With bubblewrap that code has no network, writes
    to the workspace alone, and reads nothing of yours but SCENE and each --input; it never gets
    your environment variables. A call that crashes Blender or does not stop is answered with an
    error, and the next call finds Blender started anew with the scene as the last call left it.

    The scene after each call that changed it is kept in WORKSPACE.trajectory. Run the same command
    again to continue from the last one. Ctrl-C ends it.

    \b
    Examples:
      legoworld blender serve
      legoworld blender serve room.blend --port 9900 --workspace room-work
      BLENDER_PORT=9900 DISABLE_TELEMETRY=1 mcp-for-blender
    """
    from legoworld.endpoint.serving import Serving, serve_endpoint
    from legoworld.workers.protections import protections
    from legoworld.workers.sandbox import SandboxLimits

    over = threading.Event()
    signal.signal(signal.SIGTERM, lambda _number, _frame: over.set())
    serving = Serving(
        scene=scene,
        port=port,
        workspace=workspace,
        inputs=inputs,
        held=protections(sandbox, network=network),
        limits=SandboxLimits(time_s=time_limit, memory_bytes=int(memory_limit * 2**30)),
        call_time_s=call_time_limit,
    )
    with contextlib.suppress(KeyboardInterrupt):
        serve_endpoint(serving, over, say=click.echo, notice=options.notifier(quiet))
    return 0


@command.command("mcp", context_settings=_CONTEXT)
@click.option("--workspace", type=options.FOLDER, required=True,
              help="The only folder Blender can write to.")  # fmt: skip
@_SANDBOX
@_MEMORY
@click.option("-q", "--quiet", is_flag=True, help="Print no notices on standard error.")
def mcp(
    workspace: Path,
    sandbox: Literal["auto", "bubblewrap", "limits"],
    memory_limit: float,
    quiet: bool,
) -> int:
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
    from legoworld.endpoint.serving import Serving
    from legoworld.endpoint.session import CALL_TIME_S
    from legoworld.workers.protections import protections
    from legoworld.workers.sandbox import SandboxLimits

    serving = Serving(
        scene=None,
        port=0,
        workspace=workspace,
        inputs=(),
        held=protections(sandbox),
        limits=SandboxLimits(time_s=_DAY_S, memory_bytes=int(memory_limit * 2**30)),
        call_time_s=CALL_TIME_S,
    )
    return serve_mcp(serving, notice=options.notifier(quiet))


@command.command("finalise", context_settings=_CONTEXT)
@click.argument("workspace", type=options.EXISTING_FOLDER)
@click.option("-o", "--output", type=options.FOLDER, required=True, help="The scene folder to be.")
@_SANDBOX
@_MEMORY
@options.output_options
def finalise(
    workspace: Path,
    output: Path,
    sandbox: Literal["auto", "bubblewrap", "limits"],
    memory_limit: float,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Export the submission of WORKSPACE, the way `legoworld reconstruct` does for every agent.

    That is the scene.blend that was saved last, and where there is none, or none that opens, the
    scene as the last call left it (WORKSPACE.trajectory). Its scene.blend, scene.glb and final.png
    are exported anew. Exit code 1 where there is no scene.

    \b
    Examples:
      legoworld blender finalise work -o scenes/coffee
      legoworld blender finalise work -o scenes/coffee --json
    """
    from legoworld.endpoint.workspace_finalisation import finalise_workspace
    from legoworld.workers.protections import protections
    from legoworld.workers.sandbox import SandboxLimits

    limits = SandboxLimits(time_s=_FINALISE_S, memory_bytes=int(memory_limit * 2**30))
    found = finalise_workspace(workspace, output, limits=limits, held=protections(sandbox))
    if as_json:
        options.print_json({"finalisation": found})
    elif found.source == "none":
        click.echo(f"no scene could be exported: {'; '.join(found.refused) or 'none'}", err=True)
    else:
        click.echo(f"the {found.source} scene -> {output}")
    return 1 if found.source == "none" else 0
