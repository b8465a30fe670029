"""mcp-for-blender as it comes from PyPI, in an environment of its own, and where agents find it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.baselines import environments
from legoworld.endpoint.server import HOST
from legoworld.errors import UsageError
from legoworld.files import readable_json, write_text
from legoworld.records.agents import McpFormat

PLAYER: Final = Path(__file__).with_name("blender_mcp") / "play.py"
_PROGRAM: Final = "mcp-for-blender"


@dataclass(frozen=True, kw_only=True)
class McpProject:
    """The isolated project that the server and its client are installed from."""

    name: str = _PROGRAM
    shelf: str = "agents"
    folder: Path = PLAYER.parent


_PROJECT: Final = McpProject()


def server_folder() -> Path:
    """Where its environment is, made or not."""
    return environments.environment_folder(_PROJECT)


def install_server(notice: Callable[[str], None]) -> Path:
    """Make its environment anew; its Python."""
    return environments.install(_PROJECT, notice)


def server_problems() -> list[str]:
    """What its environment lacks; empty when it is ready."""
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


def write_configuration(path: Path, kind: McpFormat, port: int, temporary: Path) -> None:
    """Write the file that tells an agent how to start the server, as the agent reads it.

    temporary: where the server looks for the pictures it asks for; the endpoint writes there. Its
    telemetry is off.
    """
    command = str(server_python().with_name(_PROGRAM))
    variables = {
        "BLENDER_HOST": HOST,
        "BLENDER_PORT": str(port),
        "DISABLE_TELEMETRY": "1",
        "TMPDIR": str(temporary),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "codex":  # https://developers.openai.com/codex/mcp; a JSON text is a TOML one
        text = "[mcp_servers.blender]\n"
        text += f"command = {json.dumps(command)}\nargs = []\ntool_timeout_sec = 180\n\n"
        text += "[mcp_servers.blender.env]\n"
        text += "".join(f"{name} = {json.dumps(value)}\n" for name, value in variables.items())
    elif kind == "opencode":  # https://opencode.ai/docs/mcp-servers/
        local = {"type": "local", "command": [command], "environment": variables, "enabled": True}
        text = readable_json(
            {"$schema": "https://opencode.ai/config.json", "mcp": {"blender": local}}
        )
    else:  # Claude Code's, Gemini CLI's and most others'
        text = readable_json(
            {"mcpServers": {"blender": {"command": command, "args": [], "env": variables}}}
        )
    write_text(path, text)
