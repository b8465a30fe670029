"""`legoworld demo`."""

from __future__ import annotations

import importlib.util
import shlex
import shutil
from importlib import import_module
from pathlib import Path
from typing import Final

import click

from legoworld import extras
from legoworld.commands.options import flag, option
from legoworld.shipped import catalog

_SCENES: Final = ("astronaut", "chelsea", "coffee", "motorcycle")


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
    photos = _write_files(output)
    if not photos:
        click.echo(f"no photos: {extras.install_command('examples')}", err=True)
    if files:
        click.echo(f"scenes, {'photos, ' * photos}tracks and truth -> {output}")
        return 0
    scenes, runs, evals, page = (output / n for n in ("scenes", "runs", "evals", "report.html"))
    tasks = [word for task in _list_tasks() for word in ("--task", task)]
    shown = ["--photos", output / "photos"] * photos
    for words in (
        ["readout", scenes, *tasks, "--track", output / "tracks", "-o", runs],
        ["evaluate", runs, "--truth", output / "truth", "-o", evals, "--overwrite"],
        ["report", evals, *shown, "--scenes", scenes, "-o", page],
    ):
        name, *arguments = map(str, words)
        click.echo(f"$ legoworld {shlex.join([name, *arguments])}")
        run = import_module(f"legoworld.commands.{name}_command").command
        with run.make_context(name, [*arguments, "-q"], click.get_current_context()) as context:
            if code := run.invoke(context):
                return int(code)
        click.echo()
    click.echo(f"open {page.resolve().as_uri()}")
    return 0


def _data_folder() -> Path:
    return catalog.folder("datasets") / "skimage_examples"


def _list_tasks() -> list[str]:
    """The tasks that the examples have ground truth for."""
    return sorted(file.stem.removeprefix("truth_") for file in _data_folder().glob("truth_*.json"))


def _write_files(folder: Path) -> bool:
    """scenes/, tracks/, truth/ and photos/; whether there are photos, which are scikit-image's."""
    for name in _SCENES:
        source = catalog.folder("examples") / name
        shutil.copytree(source, folder / "scenes" / name, dirs_exist_ok=True)
    data, tasks = _data_folder(), _list_tasks()
    for kind, place in (("track", "tracks"), ("truth", "truth")):
        (folder / place).mkdir(parents=True, exist_ok=True)
        for task in tasks:
            shutil.copyfile(data / f"{kind}_{task}.json", folder / place / f"{task}.json")
    if importlib.util.find_spec("skimage") is None:
        return False
    import cv2
    import skimage.data

    (folder / "photos").mkdir(exist_ok=True)
    for name in _SCENES:
        photo = getattr(skimage.data, "stereo_motorcycle" if name == "motorcycle" else name)()
        rgb = photo[0] if name == "motorcycle" else photo
        cv2.imwrite(str(folder / "photos" / f"{name}.png"), rgb[:, :, ::-1])
    return True
