"""mcp-for-blender as it comes from PyPI, in an environment of its own, and where agents find it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from legoworld.baselines import environments
from legoworld.endpoint.listener import HOST
from legoworld.errors import UsageError
from legoworld.files import Json, readable_json, write_text
from legoworld.records.agents import AgentMcp

PLAYER: Final = Path(__file__).with_name("blender_mcp") / "play.py"
RELAY: Final = PLAYER.with_name("relay.py")
_PROGRAM: Final = "mcp-for-blender"
#: Codex gives a server 10 s to start and a call 60 s, OpenCode 5 s to both: a render takes longer.
_CALL_S: Final = 180
_START_S: Final = 60


@dataclass(frozen=True, kw_only=True)
class McpProject:
    """The isolated project that the server and its client are installed from."""

    name: str = _PROGRAM
    shelf: str = "agents"
    folder: Path = PLAYER.parent


_PROJECT: Final = McpProject()


def server_folder() -> Path:
    """Path of its environment, which may not exist yet."""
    return environments.environment_folder(_PROJECT)


def install_server(notice: Callable[[str], None]) -> Path:
    """Make its environment anew; its Python."""
    return environments.install(_PROJECT, notice)


def server_problems() -> list[str]:
    """Problems of its environment; empty if it is ready."""
    python = environments.installed_python(_PROJECT)
    if python is None:
        return [f"{_PROGRAM} is not installed: legoworld agent install"]
    return environments.problems(_PROJECT, python)


def server_python() -> Path:
    """The Python of its environment. UsageError where there is none."""
    python = environments.installed_python(_PROJECT)
    if python is None:
        raise UsageError(
            f"{_PROGRAM}, through which agents reach Blender, has no environment yet",
            found=f"nothing in {server_folder()}",
            expected="an environment with the server from PyPI",
            next_step="`legoworld agent install`",
        )
    return python


@dataclass(frozen=True, kw_only=True)
class McpServer:
    """An MCP server as an agent starts it. name: as the agent calls it."""

    name: str
    command: str
    arguments: tuple[str, ...]
    variables: dict[str, str]


def blender_server(port: int, temporary: Path) -> McpServer:
    """mcp-for-blender over the endpoint at a port.

    temporary: where the server looks for the pictures it asks for; the endpoint writes there. Its
    telemetry is off.
    """
    return McpServer(
        name="blender",
        command=str(server_python().with_name(_PROGRAM)),
        arguments=(),
        variables={
            "BLENDER_HOST": HOST,
            "BLENDER_PORT": str(port),
            "DISABLE_TELEMETRY": "1",
            "TMPDIR": str(temporary),
        },
    )


def plugin_relay(port: int) -> McpServer:
    """The plugin's server, which runs outside of the agent's sandbox and is reached by a port."""
    return McpServer(
        name="legoworld",
        command=str(server_python()),
        arguments=(str(RELAY), HOST, str(port)),
        variables={},
    )


def write_configuration(path: Path, mcp: AgentMcp, servers: Sequence[McpServer]) -> None:
    """Write the file that tells an agent how to start its servers, with the card's settings."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if mcp.format == "codex":  # https://developers.openai.com/codex/mcp; a JSON text is a TOML one
        settings = "".join(f"{key} = {text}\n" for key, text in _dotted_lines(mcp.settings))
        text = "\n".join([settings, *(_codex(server) for server in servers)])
        write_text(path, text.lstrip())
        return
    if mcp.format == "opencode":  # https://opencode.ai/docs/mcp-servers/
        local: dict[str, Json] = {
            s.name: {
                "type": "local",
                "command": [s.command, *s.arguments],
                "environment": s.variables,
                "enabled": True,
                "timeout": 1000 * _CALL_S,
            }
            for s in servers
        }
        ours: dict[str, Json] = {"$schema": "https://opencode.ai/config.json", "mcp": local}
    else:  # Claude Code's, Gemini CLI's and most others'
        started: dict[str, Json] = {
            s.name: {"command": s.command, "args": list(s.arguments), "env": s.variables}
            for s in servers
        }
        ours = {"mcpServers": started}
    write_text(path, readable_json({**mcp.settings, **ours}))


def _dotted_lines(settings: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """A table's lines in TOML: keys from the top, so that none of them opens a table."""
    for key, value in settings.items():
        name = f"{above}{json.dumps(key)}"
        if isinstance(value, dict):
            yield from _dotted_lines(value, f"{name}.")
        else:
            yield name, json.dumps(value)


def _codex(server: McpServer) -> str:
    text = f"[mcp_servers.{server.name}]\ncommand = {json.dumps(server.command)}\n"
    text += f"args = {json.dumps(list(server.arguments))}\nstartup_timeout_sec = {_START_S}\n"
    text += f"tool_timeout_sec = {_CALL_S}\n\n"
    text += f"[mcp_servers.{server.name}.env]\n"
    return text + "".join(f"{k} = {json.dumps(v)}\n" for k, v in server.variables.items())
