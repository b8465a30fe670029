"""`legoworld blender serve`: one session and its port, until interrupted."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from legoworld.endpoint.listener import HOST
from legoworld.endpoint.server import EndpointServer
from legoworld.endpoint.session import Session, Trial
from legoworld.errors import UsageError
from legoworld.scene.folder import BLEND
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import SandboxLimits


@dataclass(frozen=True, kw_only=True)
class EndpointOptions:
    """Options of an endpoint. workspace: None for a folder named after the port."""

    scene: Path | None
    port: int
    workspace: Path | None
    inputs: Sequence[Path]
    protections: Protections
    limits: SandboxLimits
    call_time_s: float


def serve_endpoint(
    serving: EndpointOptions,
    over: threading.Event,
    *,
    say: Callable[[str], None],
    notice: Callable[[str], None],
) -> None:
    """Serve until `over` is set or the time limit is reached."""
    with open_endpoint(serving, notice=notice) as port:
        say(f"listening on {HOST}:{port}")
        over.wait(serving.limits.time_s)


def workspace_path(serving: EndpointOptions) -> Path:
    """The folder that Blender can write to."""
    return serving.workspace or Path(f"blender-{serving.port}")


def record_path(workspace: Path) -> Path:
    """Folder of a workspace's calls and scenes."""
    workspace = workspace.resolve()
    return workspace.with_name(f"{workspace.name}.trajectory")


@contextmanager
def open_endpoint(serving: EndpointOptions, *, notice: Callable[[str], None]) -> Iterator[int]:
    """An endpoint with its Blender; its port."""
    workspace = workspace_path(serving)
    workspace.mkdir(parents=True, exist_ok=True)
    _refuse_second_scene(serving.scene, workspace)
    record = record_path(workspace)
    session = Session(
        Trial(
            workspace=workspace,
            record=record,
            limits=serving.limits,
            protections=serving.protections,
            inputs=serving.inputs,
            blend=serving.scene,
            call_time_s=serving.call_time_s,
        )
    )
    with closing(session), EndpointServer(session, serving.port) as server:
        if session.record.checkpoints:
            notice(f"continuing {record} after {len(session.record.calls)} calls")
        session.start()
        held = serving.protections
        notice(f"runs any code it is sent; kept from it: {', '.join(held.holds)}")
        if held.does_not_hold:
            why = f" ({held.why_not})" if held.why_not else ""
            notice(f"warning: not kept from it: {', '.join(held.does_not_hold)}{why}")
        notice(f"Blender writes to {workspace}; every scene is kept in {record}")
        yield server.port


def _refuse_second_scene(scene: Path | None, workspace: Path) -> None:
    saved = workspace / BLEND
    if scene is not None and saved.exists() and scene.resolve() != saved.resolve():
        raise UsageError(
            f"the workspace has a {BLEND} already, and it is never overwritten",
            found=str(saved),
            expected=f"a workspace without one, or that one as SCENE: {saved}",
            next_step="pass another --workspace",
        )
