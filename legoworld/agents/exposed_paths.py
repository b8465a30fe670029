"""What an agent's sandbox shows of its installation, and that it starts with no more than that."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from legoworld.agents.agent_cards import OF_THE_SERVER, AgentCard
from legoworld.agents.mcp_server import PLAYER, server_folder
from legoworld.errors import LegoWorldError, UsageError, one_line
from legoworld.workers.bubblewrap import always_shown
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import Sandbox, SandboxLimits
from legoworld.workers.scratch import scratch_folder

_PACKAGES: Final = "node_modules"
_VERSION_LIMITS: Final = SandboxLimits(time_s=60.0, memory_bytes=2 << 30)


class AgentNotStartedError(LegoWorldError):
    """An agent's program does not start in its sandbox."""

    code = "agent_not_started"


def exposed_paths(card: AgentCard) -> list[Path]:
    """Files and folders an agent can read in addition to the system's and its workspace.

    What every agent reaches Blender by; the program of its command, the npm package that is in, and
    the interpreter of its first line; what the card's `shown` names. No folder for what is in it.
    """
    return [*(path for path in (server_folder(), PLAYER.parent) if path.exists()), *_of_card(card)]


def _of_card(card: AgentCard) -> list[Path]:
    shown = [card.path.parent.resolve() / Path(name).expanduser() for name in card.about.shown]
    for path in shown:
        if not path.exists():
            raise UsageError(
                f"`shown` of the card {card.path.name} names what is not there",
                found=str(path),
                expected="files and folders, relative to the card or with ~",
            )
    program = shutil.which(card.program)
    if program is not None and card.program not in OF_THE_SERVER:
        real = Path(program).resolve()
        shown += [_absolute(program), real, *_package(real)]
        for name in _interpreter(real):
            shown += [_absolute(name), Path(name).resolve()]
    return list(dict.fromkeys(shown))


def refuse_exposed(card: AgentCard, kept: Sequence[Path]) -> None:
    """Raise UsageError if an agent's sandbox would expose withheld files.

    kept: the track, the photos and everything made from them. Exposed paths must not contain one;
    those of the card must not lie below one either, nor contain a home folder.
    """
    own = [path.resolve() for path in _of_card(card)]
    places = [path.resolve() for path in kept]
    for shown in [*own, *exposed_paths(card), *always_shown()]:
        held = [path for path in places if path.is_relative_to(shown)]
        if shown in own:
            held += [path for path in places if shown.is_relative_to(path)]
            held += [Path.home()] if Path.home().is_relative_to(shown) else []
        if held:
            raise UsageError(
                f"the agent {card.name} would be shown {shown}",
                found=f"it holds, or is below, {held[0]}",
                expected="nothing of a home, the track, the photos and the output",
                next_step="move them, or name in `shown` of the card only what the agent needs",
            )


def version_in_sandbox(card: AgentCard, protections: Protections) -> str | None:
    """Version that an agent prints in its sandbox; None if its card has no version command.

    AgentNotStartedError where it does not end well there.
    """
    command = card.about.version_command
    program = shutil.which(command[0]) if command else None
    if program is None:
        return None
    with (
        scratch_folder("legoworld-agent-") as scratch,
        Sandbox(scratch, _VERSION_LIMITS, protections, owner=scratch) as sandbox,
    ):
        sandbox.start([str(_absolute(program)), *command[1:]], exposed_paths(card))
        ending = sandbox.wait()
    if ending.code == 0:
        return one_line(ending.last_output, 100) or None
    how = f"exit code {ending.code}" if ending.over is None else f"its {ending.over} limit"
    raise AgentNotStartedError(
        f"{card.program} does not start in the agent's sandbox",
        found=f"{how}; {one_line(ending.last_output[-200:])}",
        expected=f"the version that `{' '.join(command)}` prints",
        next_step="name what it reads to start in `shown` of its card; docs/agents.md",
    )


def _absolute(name: str) -> Path:
    return Path(os.path.abspath(name))  # noqa: PTH100  links stay: it is started by this name


def _package(program: Path) -> list[Path]:
    """The npm package that a program is in: node_modules/NAME or node_modules/@SCOPE/NAME."""
    parts = program.parts
    if _PACKAGES not in parts:
        return []
    at = len(parts) - parts[::-1].index(_PACKAGES)
    return [Path(*parts[: at + (2 if parts[at].startswith("@") else 1)])]


def _interpreter(program: Path) -> list[str]:
    """The program that a script's first line names, as it is found on the PATH."""
    with program.open("rb") as stream:
        first = stream.read(256).split(b"\n")[0]
    if not first.startswith(b"#!"):
        return []
    words = [os.fsdecode(word) for word in first[2:].split()]
    if words and Path(words[0]).name == "env":
        words = [word for word in words[1:] if not word.startswith("-")]
    resolved = shutil.which(words[0]) if words else None
    return [] if resolved is None else [resolved]
