"""`legoworld bench`: the group; each of its commands is in a module of its own."""

from __future__ import annotations

from legoworld.commands import options
from legoworld.commands.bench_export import export_command, reward_command
from legoworld.commands.bench_make import make_command
from legoworld.commands.bench_serve import serve_command
from legoworld.commands.bench_table import judges_command, table_command


@options.group("bench")
def command() -> None:
    """Make reference cases from any scene, and use them: LEGO-Bench.

    \b
    Examples:
      legoworld bench make references -o bench
      legoworld bench serve bench --no-render < requests.jsonl
      legoworld bench export --harbor bench -o tasks
      legoworld bench table evals/mine evals/other -o table
    """


command.add_command(make_command)
command.add_command(serve_command)
command.add_command(export_command)
command.add_command(reward_command)
command.add_command(table_command)
command.add_command(judges_command)
