"""`legoworld baseline`: the group, and `install`; `run` and `import` are in their own modules."""

from __future__ import annotations

import click

from legoworld.commands import options
from legoworld.commands.baseline_import import import_command
from legoworld.commands.baseline_run import run_command
from legoworld.commands.options import option
from legoworld.commands.output import Output


@options.group("baseline")
def command() -> None:
    """Run a specialist model over a track's photos, or import results, as a run folder.

    \b
    Examples:
      legoworld baseline install dino
      legoworld baseline run dino --task coco --track track.json --photos val2017 \\
          --weights dino.pth -o runs/dino
      legoworld baseline import results.json --task coco --track track.json -o runs/theirs
    """


command.add_command(run_command)
command.add_command(import_command)


@command.command("install")
@click.argument("name")
@option(
    "--torch-index",
    "Package index for torch, such as one with CPU-only or CUDA wheels.",
    metavar="URL",
)
@option("--with extra", "Extra package to install; repeatable.", multiple=True, metavar="PACKAGE")
@options.printing
def install(name: str, torch_index: str | None, extra: tuple[str, ...], out: Output) -> int:
    """Create the environment of the baseline NAME in the user's data folder, replacing any old one.

    Uses uv where it is installed, venv and pip otherwise, and installs only the baseline's own
    requirements. `legoworld doctor` lists the baselines that have an environment.

    \b
    Examples:
      legoworld baseline install dino
      legoworld baseline install da3 --torch-index https://.../whl/cpu
      legoworld baseline install hf-detector --with torchvision==0.28.0 --json
    """
    from legoworld.baselines import environments
    from legoworld.baselines.cards import load_baseline

    card = load_baseline(name)
    python = environments.install(card, out.notice, torch_index=torch_index, extra=extra)
    lacking = environments.problems(card, python)
    out.show(
        {"baseline": name, "python": str(python), "lacking": lacking},
        [*lacking, f"{name} {'is not ready' if lacking else 'is ready'} -> {python}"],
    )
    return 1 if lacking else 0
