"""One MCP handshake with mcp-for-blender, in the sandbox that an agent starts it in."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from legoworld.agents.agent_cards import AgentCard
from legoworld.agents.exposed_paths import AgentNotStartedError, exposed_paths
from legoworld.agents.mcp_server import PLAYER, blender_server, server_python, write_configuration
from legoworld.beneath import Beneath, RefusedFileError
from legoworld.errors import one_line
from legoworld.records.agents import AgentMcp
from legoworld.records.atif import AtifTrajectory
from legoworld.records.base import RecordError, decode
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import Sandbox, SandboxLimits
from legoworld.workers.scratch import scratch_folder

_LIMITS: Final = SandboxLimits(time_s=120.0, memory_bytes=2 << 30)
#: Nothing listens there: the server is asked what it offers, and no Blender.
_NO_BLENDER: Final = 9
_MOST_BYTES: Final = 4 << 20


def offered_tools(card: AgentCard, protections: Protections) -> list[str]:
    """The tools that mcp-for-blender names after `initialize` and `tools/list`.

    The client is the one of `program`, without a step. AgentNotStartedError where they fail.
    """
    with (
        scratch_folder("legoworld-handshake-") as scratch,
        Sandbox(scratch, _LIMITS, protections, owner=scratch) as sandbox,
    ):
        inside, output = sandbox.path_inside("output"), scratch / "output"
        server = blender_server(_NO_BLENDER, inside)
        write_configuration(
            output / "mcp.json", AgentMcp(format="mcp_servers", path="mcp.json"), [server]
        )
        for name in ("steps", "prompt"):
            (output / name).write_text("", encoding="utf-8")
        names = {"mcp-config": "mcp.json", "steps": "steps", "prompt": "prompt", "transcript": "t"}
        given = [word for key, name in names.items() for word in (f"--{key}", str(inside / name))]
        sandbox.start([str(server_python()), str(PLAYER), *given], exposed_paths(card))
        ending = sandbox.wait()
        tools = _tools(scratch) if ending.code == 0 else []
    if tools:
        return tools
    how = f"exit code {ending.code}" if ending.over is None else f"its {ending.over} limit"
    raise AgentNotStartedError(
        "mcp-for-blender does not answer in the agent's sandbox",
        found=f"{how}; {one_line(ending.last_output[-200:])}",
        expected="an answer to initialize and tools/list",
        next_step="`legoworld agent install` makes its environment anew",
    )


def _tools(scratch: Path) -> list[str]:
    """The tools in the transcript that the sandboxed client wrote."""
    try:
        with Beneath(scratch) as inside:
            data = inside.read("output/t", most_bytes=_MOST_BYTES) or b""
        agent = decode(AtifTrajectory, data).agent
    except (OSError, RecordError, RefusedFileError):
        return []
    return [str(one["function"]["name"]) for one in agent.tool_definitions or []]
