"""`legoworld demo`."""

from __future__ import annotations

import shlex
from importlib import import_module
from pathlib import Path

import click

from legoworld import extras
from legoworld.commands.options import flag, option
from legoworld.shipped.demo import TASKS, write_example_files


@click.command("demo")
@option("--output", "Folder to write.", required=False, default=Path("legoworld-demo"))
@flag("--files", "Only write the scenes, photos, tracks and ground truth.")
def command(output: Path, files: bool) -> int:
    """Read out, score and report the shipped examples, by the commands that are printed.

    The four photos come from scikit-image; without it the page has none. The ground truth was drawn
    by hand on the photos by an annotator blind to the scenes.

    \b
    Examples:
      legoworld demo
      legoworld demo --files -o examples
    """
    photos = write_example_files(output)
    if not photos:
        click.echo(f"no photos: {extras.install_command('examples')}", err=True)
    if files:
        click.echo(f"scenes, {'photos, ' * photos}tracks and truth -> {output}")
        return 0
    named = {name: output / name for name in ("scenes", "tracks", "truth", "runs", "evals")}
    page = output / "report.html"
    tasks = [word for task in TASKS for word in ("--task", task)]
    shown = ["--photos", output / "photos"] if photos else []
    shown += ["--scenes", named["scenes"]]
    for words in (
        ["readout", named["scenes"], *tasks, "--track", named["tracks"], "-o", named["runs"]],
        ["evaluate", named["runs"], "--truth", named["truth"], "-o", named["evals"], "--overwrite"],
        ["report", named["evals"], *shown, "-o", page],
    ):
        name, *arguments = map(str, words)
        click.echo(f"$ legoworld {shlex.join([name, *arguments])}")
        run = import_module(f"legoworld.commands.{name}_command").command
        if code := run.main([*arguments, "-q"], prog_name=name, standalone_mode=False):
            return int(code)
        click.echo()
    click.echo(f"open {page.resolve().as_uri()}")
    return 0
