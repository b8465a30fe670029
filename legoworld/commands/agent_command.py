"""`legoworld agent`."""

from __future__ import annotations

from typing import Any

import click

from legoworld.commands import options

_HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}


@click.group("agent", context_settings=_HELP)
def command() -> None:
    """The coding agents that `legoworld reconstruct` can run, and what they need.

    \b
    Examples:
      legoworld agent list
      legoworld agent check codex
      legoworld agent install
    """


@command.command("list", context_settings=_HELP)
@options.output_options
def list_agents(as_json: bool, quiet: bool, verbose: bool) -> int:
    """Print the agents there are cards for.

    \b
    Examples:
      legoworld agent list
      legoworld agent list --json
    """
    from legoworld.agents.agent_cards import agent_cards

    cards = agent_cards()
    if as_json:
        options.print_json({"agents": [card.about for card in cards]})
        return 0
    rows = [[c.name, c.about.title, "yes" if c.about.run else "no", c.about.checked] for c in cards]
    click.echo(options.table(["name", "what", "run", "checked"], rows))
    return 0


@command.command("check", context_settings=_HELP)
@click.argument("name")
@options.output_options
def check(name: str, as_json: bool, quiet: bool, verbose: bool) -> int:
    """Say what the agent NAME lacks on this machine. Exit code 1 when it cannot run.

    Nothing is started but the agent's own --version, in the sandbox that its trials have; whether a
    login is still valid is not asked.

    \b
    Examples:
      legoworld agent check program
      legoworld agent check my-agent.toml
    """
    from legoworld.agents.agent_cards import agent_problems, load_agent
    from legoworld.agents.shown import AgentNotStartedError, version_in_sandbox
    from legoworld.workers.protections import protections

    card = load_agent(name)
    problems, version = agent_problems(card), None
    held = protections("auto", network=card.about.network)
    try:
        version = version_in_sandbox(card, held)
    except AgentNotStartedError as error:
        problems.append(str(error))
    if as_json:
        options.print_json(
            {"name": card.name, "problems": problems, "version": version, "sandbox": held.record()}
        )
        return 1 if problems else 0
    click.echo(f"{card.name}: {card.about.title}; {version or 'version not known'}")
    click.echo(f"kept from it: {', '.join(held.holds)}")
    if not card.about.run:
        click.echo(f"warning: checked {card.about.checked}")
    for problem in problems:
        click.echo(f"lacks: {problem}")
    if not problems:
        click.echo("ready")
    return 1 if problems else 0


@command.command("install", context_settings=_HELP)
@options.output_options
def install(as_json: bool, quiet: bool, verbose: bool) -> int:
    """Install mcp-for-blender, through which every agent reaches Blender, in its own environment.

    The unmodified package from PyPI, in the user's data folder. The agents themselves are installed
    as their own documentation says; `legoworld agent check` names the command.

    \b
    Examples:
      legoworld agent install
      legoworld agent install --json
    """
    from legoworld.agents.mcp_server import install_server

    python = install_server(options.notifier(quiet))
    if as_json:
        options.print_json({"python": str(python)})
    else:
        click.echo(f"ready: {python}")
    return 0
