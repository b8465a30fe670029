"""`legoworld track`: the group, and `check`; `make` is in its own module."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from legoworld.commands import options
from legoworld.commands.track_making import make_command
from legoworld.pluralize import share, word_for
from legoworld.records.base import Storable

_HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}


@click.group("track", context_settings=_HELP)
def command() -> None:
    """Make a public track (a list of images and categories), or check one against its photos.

    \b
    Examples:
      legoworld track make --task coco --truth instances_val2017.json --sample 100 -o track.json
      legoworld track check track.json --photos coco/val2017
    """


command.add_command(make_command)


@command.command("check", context_settings=_HELP)
@click.argument("track", type=options.EXISTING_FILE)
@click.option("--photos", required=True, type=options.EXISTING_FOLDER, help="Folder of the photos.")
@options.output_options
def check_command(track: Path, photos: Path, as_json: bool, quiet: bool, verbose: bool) -> int:
    """Check that every photo of TRACK exists, decodes, and has the size the track says.

    Exit code 1 otherwise.

    \b
    Examples:
      legoworld track check track.json --photos coco/val2017
      legoworld track check track.json --photos coco --json
    """
    from legoworld.readouts.pictures import read_photo
    from legoworld.track_making.making import check_photos
    from legoworld.tracks.track import load_track

    def size_of(path: Path) -> tuple[int, int]:
        height, width = read_photo(path).shape[:2]
        return width, height

    images = load_track(track).images
    problems = check_photos(images, photos, size_of)
    if as_json:
        rows: list[dict[str, Storable]] = [
            {
                "image_id": p.image.id,
                "file_name": p.image.file_name,
                "status": p.status,
                "found": p.found,
            }
            for p in problems
        ]
        options.print_json({"images": len(images), "problems": rows})
    else:
        for p in problems[:50]:
            click.echo(f"{p.status}: {p.image.file_name} (image {p.image.id}): {p.found}")
        if len(problems) > 50:
            click.echo(f"... and {len(problems) - 50} more (--json lists them)")
        n_good = len(images) - len(problems)
        good = share(n_good, len(images), "photo", "photos")
        click.echo(f"{good} {word_for(n_good, 'matches', 'match')} the track")
    return 1 if problems else 0
