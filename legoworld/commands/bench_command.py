"""`legoworld bench`: the group; each of its commands is in a module of its own."""

from __future__ import annotations

import click

from legoworld.commands.bench_make import make_command


@click.group("bench", context_settings={"help_option_names": ["-h", "--help"]})
def command() -> None:
    """Make reference cases from any scene, and use them: LEGO-Bench.

    \b
    Examples:
      legoworld bench make references -o bench
      legoworld bench make references -o bench --size 960x540
      legoworld readout submissions --task bench --track bench/public/track.json -o runs/mine
      legoworld evaluate runs/mine --truth bench/private -o evals/mine
    """


command.add_command(make_command)
