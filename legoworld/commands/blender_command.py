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


@click.group("blender", context_settings=_CONTEXT)
def command() -> None:
    """A headless Blender that coding agents drive.

    \b
    Examples:
      legoworld blender serve
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
@click.option(
    "--sandbox", type=options.Choice(["auto", "bubblewrap", "limits"]), default="auto",
    show_default=True,
    help="auto: bubblewrap where it works, limits alone elsewhere; bubblewrap: or fail.",
)  # fmt: skip
@click.option(
    "--time-limit", default=14400.0, show_default=True, type=click.FloatRange(min=0.1),
    help="Seconds until the endpoint ends.",
)  # fmt: skip
@click.option(
    "--call-time-limit", default=165.0, show_default=True, type=click.FloatRange(min=0.1),
    help="Seconds one call may take; mcp-for-blender gives up after 180.",
)  # fmt: skip
@click.option(
    "--memory-limit", default=8.0, show_default=True, type=click.FloatRange(min=0.1),
    help="GiB Blender and what it starts may use together.",
)  # fmt: skip
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
    from legoworld.workers.sandbox import SandboxLimits, protections

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
