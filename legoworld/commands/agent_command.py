"""`legoworld agent`."""

from __future__ import annotations

import click

from legoworld.commands import options
from legoworld.commands.output import Output, table


@options.group("agent")
def command() -> None:
    """The coding agents that `legoworld reconstruct` can run, and what they need.

    \b
    Examples:
      legoworld agent list
      legoworld agent check codex
      legoworld agent install
    """


@command.command("list")
@options.printing
def list_agents(out: Output) -> int:
    """Print the agents there are cards for.

    \b
    Examples:
      legoworld agent list
      legoworld agent list --json
    """
    from legoworld.agents.agent_cards import agent_cards

    cards = agent_cards()
    rows = [[c.name, c.about.title, "yes" if c.about.run else "no", c.about.checked] for c in cards]
    out.show(
        {"agents": [card.about for card in cards]}, table(["name", "what", "run", "checked"], rows)
    )
    return 0


@command.command("check")
@click.argument("name")
@options.printing
def check(name: str, out: Output) -> int:
    """Say what the agent NAME lacks on this machine. Exit code 1 when it cannot run.

    In the sandbox that its trials have, the agent's own --version is started, and mcp-for-blender
    is asked for its tools (initialize, tools/list). Whether a login is still valid is not asked.

    \b
    Examples:
      legoworld agent check program
      legoworld agent check my-agent.toml
    """
    from legoworld.agents.agent_cards import agent_problems, load_agent
    from legoworld.agents.exposed_paths import AgentNotStartedError, version_in_sandbox
    from legoworld.agents.handshake import offered_tools
    from legoworld.agents.mcp_server import server_problems
    from legoworld.workers.protections import protections

    card = load_agent(name)
    problems, version, tools = agent_problems(card), None, list[str]()
    held = protections("auto", network=card.about.network)
    try:
        version = version_in_sandbox(card, held)
        tools = [] if server_problems() else offered_tools(card, held)
    except AgentNotStartedError as error:
        problems.append(str(error))
    out.show(
        {
            "name": card.name,
            "problems": problems,
            "version": version,
            "tools": tools,
            "sandbox": held.record(),
        },
        [
            f"{card.name}: {card.about.title}; {version or 'version not known'}",
            f"kept from it: {', '.join(held.holds)}",
            *([f"Blender's tools: {', '.join(tools)}"] if tools else []),
            *([] if card.about.run else [f"warning: checked {card.about.checked}"]),
            *(f"lacks: {problem}" for problem in problems),
            *([] if problems else ["ready"]),
        ],
    )
    return 1 if problems else 0


@command.command("install")
@options.printing
def install(out: Output) -> int:
    """Install mcp-for-blender, through which every agent reaches Blender, in its own environment.

    The unmodified package from PyPI, in the user's data folder. The agents themselves are installed
    as their own documentation says; `legoworld agent check` names the command.

    \b
    Examples:
      legoworld agent install
      legoworld agent install --json
    """
    from legoworld.agents.mcp_server import install_server

    python = install_server(out.notice)
    out.show({"python": str(python)}, f"ready: {python}")
    return 0
