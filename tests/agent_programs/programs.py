"""What the four agents' programs need to talk to a model server of the tests."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from agent_programs.model_server import Turn

from legoworld.agents.agent_cards import load_agent


@dataclass(frozen=True, kw_only=True)
class Program:
    """What a card of one's own adds to a shipped one, whose API the recorder forwards to.

    reads: the tool by which the model sees the photo, where the program does not show it at once;
    counted: whether its transcript counts the requests that have no tools (titles, routing).
    """

    settings: str = "{}"
    variables: str = ""
    reads: str | None = None
    counted: bool = True


AGENTS = {
    "claude": Program(
        variables='CLAUDE_CODE_DISABLE_NONESSENTIAL_TRAFFIC = "1"',
        reads="Read",
    ),
    "codex": Program(),
    "gemini": Program(),
    "opencode": Program(
        settings='{model = "anthropic/claude-sonnet-4-5"}',
        variables='OPENCODE_DISABLE_MODELS_FETCH = "1"',
        counted=False,
    ),
}
KEY = "sk-a-secret-of-9604"
KEYS = ("ANTHROPIC_API_KEY", "CODEX_API_KEY", "GEMINI_API_KEY")


def code(says: str, text: str) -> Turn:
    """A turn that runs code in Blender."""
    arguments = {"code": f"import bpy\n{text}", "user_prompt": "Rebuild the photo."}
    return Turn(says=says, tool="execute_blender_code", arguments=arguments)


def write_card(name: str, api: str, folder: Path) -> Path:
    """The shipped card of an agent whose requests go to another API."""
    program = AGENTS[name]
    added = f"settings = {program.settings}\n\n[transcript]"
    card = load_agent(name).path.read_text().replace("[transcript]", added)
    card = re.sub('api = "https:[^"]*"', f'api = "{api}"', card)
    path = folder / f"{name}.toml"
    path.write_text(card + "\n" + program.variables + "\n")
    return path
