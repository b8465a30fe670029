"""Agents by their card: what is started, what it needs, how what it writes is read."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Formatter
from typing import Final

from legoworld.agents.mcp_server import server_problems
from legoworld.cards import read_toml
from legoworld.errors import CatalogError, UsageError
from legoworld.files import home_folder, sha256_of_file
from legoworld.pluralize import nearest_names
from legoworld.records.agents import AgentCardFile

_CARDS: Final = Path(__file__).with_name("cards")
#: Replaced in the command before it is started: these are of the MCP server's environment.
OF_THE_SERVER: Final = ("{mcp_python}",)

#: What a card's words may name; agent_process fills them in.
PLACEHOLDERS: Final = frozenset(
    {
        "home",
        "image",
        "image_name",
        "mcp_config",
        "mcp_python",
        "model_arguments",
        "player",
        "prompt",
        "prompt_file",
        "steps",
        "transcript",
        "workspace",
    }
)


@dataclass(frozen=True, kw_only=True)
class AgentCard:
    """A card, and the hash of its file."""

    about: AgentCardFile
    path: Path
    sha256: str

    @property
    def name(self) -> str:
        """The name used to select it."""
        return self.about.name

    @property
    def program(self) -> str:
        """The first word of its command."""
        return self.about.command[0]


def agent_cards() -> list[AgentCard]:
    """Every agent there is a card for, by name."""
    return [read_agent_card(path) for path in sorted(_CARDS.glob("*.toml"))]


def load_agent(name: str) -> AgentCard:
    """An agent by name, or by the path of a card of your own, which ends in .toml.

    Raises UsageError where there is no such agent.
    """
    path = Path(name) if name.endswith(".toml") else _CARDS / f"{name}.toml"
    if path.is_file():
        return read_agent_card(path)
    names = sorted(p.stem for p in _CARDS.glob("*.toml"))
    near = nearest_names(name, names)
    raise UsageError(
        "there is no such agent",
        found=repr(name),
        expected=" or ".join([*(near or names), "the path of a card, ending in .toml"]),
        next_step="`legoworld agent list` shows them all",
    )


def read_agent_card(path: Path) -> AgentCard:
    """Read a card. CatalogError says what it lacks."""
    about = read_toml(
        AgentCardFile,
        path,
        what=f"the card {path.name}",
        expected="a card such as those of legoworld/agents/cards",
        next_step="docs/agents.md says what a card holds",
    )
    if about.name != path.stem:
        raise CatalogError(
            f"the card {path.name} cannot be used",
            found=f"name = {about.name!r}",
            expected=f"the name of its file, {path.stem!r}",
        )
    _check_placeholders(about, path)
    return AgentCard(about=about, path=path, sha256=sha256_of_file(path))


def _check_placeholders(about: AgentCardFile, path: Path) -> None:
    words = [*about.command, *about.continue_command, *about.variables.values(), about.mcp.path]
    recorded = about.record.variables.values() if about.record else ()
    for word in [*words, *(text.replace("{api}", "") for text in recorded)]:
        try:
            named = {name for _, name, _, _ in Formatter().parse(word) if name is not None}
        except ValueError:
            named = {word}
        if unknown := sorted(named - PLACEHOLDERS):
            raise CatalogError(
                f"the card {path.name} has a word that cannot be filled in",
                found=f"{{{unknown[0]}}} in {word!r}",
                expected=" or ".join(f"{{{name}}}" for name in sorted(PLACEHOLDERS)),
                next_step="write {{ and }} for braces that the agent should get",
            )


def agent_problems(card: AgentCard, caller: Mapping[str, str] | None = None) -> list[str]:
    """Missing prerequisites of an agent on this machine; empty if it can start.

    caller: os.environ. A login is there when one of its variables is, or one of its files.
    """
    caller = os.environ if caller is None else caller
    problems = server_problems()
    needs = card.about.needs
    if card.program not in OF_THE_SERVER and shutil.which(card.program) is None:
        problems.append(f"{card.program} is not installed: {needs.install}")
    logins = [f"${name}" for name in needs.variables if caller.get(name)]
    logins += [f"~/{name}" for name in needs.credentials if (home_folder() / name).is_file()]
    if (needs.variables or needs.credentials) and not logins:
        wanted = [*(f"${name}" for name in needs.variables), *(f"~/{n}" for n in needs.credentials)]
        problems.append(f"no login: none of {', '.join(wanted)}")
    return problems
