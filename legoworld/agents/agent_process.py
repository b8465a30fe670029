"""An agent's own process: its command, what it is shown and given, and what it wrote."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.agents.agent_cards import AgentCard
from legoworld.agents.budget import BudgetWatch
from legoworld.agents.exposed_paths import exposed_paths
from legoworld.agents.mcp_server import (
    PLAYER,
    blender_server,
    plugin_relay,
    server_python,
    write_configuration,
)
from legoworld.agents.stop import Stop
from legoworld.agents.unfinished_trial import UnfinishedTrial
from legoworld.agents.workspaces import PROMPT, Workspace
from legoworld.beneath import Beneath
from legoworld.files import home_folder
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import Ending, Sandbox, SandboxLimits

_STDOUT: Final = "stdout.jsonl"
_STEPS: Final = "steps.jsonl"
MODEL_ARGUMENTS: Final = "{model_arguments}"
#: What its command line is run by, so that all it prints is kept: a sandbox keeps both ends alone.
_KEEPING: Final = ("/bin/sh", "-c", 'out=$1; shift; exec "$@" > "$out"', "sh")


@dataclass(frozen=True, kw_only=True)
class Order:
    """One agent invocation.

    port: of its Blender; plugin_port: of the plugin's server, None without it; steps: what
    `program` plays, else None; model: None for its own; continues: whether a part of the trial is
    made already; watch: what ends it where its budget is spent.
    """

    card: AgentCard
    workspace: Workspace
    port: int
    plugin_port: int | None
    steps: str | None
    model: str | None
    protections: Protections
    limits: SandboxLimits
    continues: bool
    trial: UnfinishedTrial
    watch: BudgetWatch


def run_agent(order: Order, stop: Stop) -> Ending:
    """Run an agent until it exits or times out, then copy its transcript, complete or not.

    Should legoworld be killed, the keeper removes the agent's folder; of a trial that continues
    its home alone, where its login is.
    """
    about, scratch = order.card.about, order.trial.agent
    home = scratch / "sandbox" / "home"
    (scratch / "sandbox").mkdir()
    variables = _declared_variables(order)
    with Sandbox(
        scratch / "sandbox",
        order.limits,
        order.protections,
        owner=home if order.trial.stays else scratch,
        workspace=order.workspace.folder,
        variables=variables,
        lease=order.trial.lease,
    ) as sandbox:
        words = _words(order, str(sandbox.path_inside("home")), str(sandbox.path_inside("output")))
        sandbox.add_variables(
            {name: text.format_map(words) for name, text in about.variables.items()}
        )
        configuration = home / Path(about.mcp.path.format_map({**words, "home": str(home)}))
        servers = [blender_server(order.port, order.workspace.folder / "tmp")]
        if order.plugin_port is not None:
            servers.append(plugin_relay(order.plugin_port))
        write_configuration(configuration, about.mcp, servers)
        words["mcp_config"] = about.mcp.path.format_map(words)
        for name in about.needs.credentials:
            (home / name).parent.mkdir(parents=True, exist_ok=True)
            if (home_folder() / name).is_file():
                shutil.copyfile(home_folder() / name, home / name)
        if order.steps is not None:
            steps = scratch / "sandbox" / "output" / _STEPS
            steps.write_text(order.steps, encoding="utf-8")
        _open_session(order, home, str(sandbox.path_inside("output")))
        command = build_command(order.card, words, order.model, continues=order.continues)
        program = shutil.which(command[0]) or command[0]
        kept = str(sandbox.path_inside("output") / _STDOUT)
        sandbox.start([*_KEEPING, kept, program, *command[1:]], exposed_paths(order.card))
        with stop.ends(sandbox.stop), order.watch.ends(sandbox.stop):
            ending = sandbox.wait()
        order.trial.take_transcript(output_name(order.card))
    return ending


def build_command(
    card: AgentCard, words: Mapping[str, str], model: str | None, *, continues: bool
) -> list[str]:
    """The command of a card with its placeholders replaced, and the words that name the model."""
    about = card.about
    command: list[str] = []
    for word in (about.continue_command if continues else ()) or about.command:
        if word != MODEL_ARGUMENTS:
            command.append(word.format_map(words))
        elif model is not None:
            command += [text.format_map({"model": model}) for text in about.model_arguments]
    return command


def output_name(card: AgentCard) -> str:
    """The file that an agent's transcript is in, in the folder of its output."""
    return card.about.transcript.path or _STDOUT


def _open_session(order: Order, home: Path, seen: str) -> None:
    """Let the agent find, and keep, what it continues from: outside of its home, which goes."""
    output = order.trial.agent / "sandbox" / "output"
    if order.trial.session.is_dir():
        order.trial.session.rename(output / "session")
    for name in order.card.about.session_folders:
        with Beneath(output) as inside:  # of this part, with what an earlier one left in it
            inside.make_folder(f"session/{name}")
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).symlink_to(f"{seen}/session/{name}")


def _words(order: Order, home: str, output: str) -> dict[str, str]:
    """Values of a card's placeholders."""
    workspace = order.workspace
    return {
        "image": str(workspace.image),
        "image_name": workspace.image.name,
        "prompt": workspace.prompt,
        "prompt_file": str(workspace.folder / PROMPT),
        "workspace": str(workspace.folder),
        "home": home,
        "steps": f"{output}/{_STEPS}",
        "transcript": f"{output}/{output_name(order.card)}",
        "mcp_python": str(server_python()),
        "player": str(PLAYER),
    }


def _declared_variables(order: Order) -> dict[str, str]:
    """The caller's variables that the card names."""
    wanted = order.card.about.needs.variables
    return {name: os.environ[name] for name in wanted if name in os.environ}
