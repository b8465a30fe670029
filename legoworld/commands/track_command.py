"""`legoworld track`: the group, and `check`; `make` is in its own module."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FILE
from legoworld.commands.track_make import make_command
from legoworld.pluralize import share, word_for

if TYPE_CHECKING:
    from legoworld.commands.output import Document


@options.group("track")
def command() -> None:
    """Make a public track (a list of images and categories), or check one against its photos.

    \b
    Examples:
      legoworld track make --task coco --truth instances_val2017.json --sample 100 -o track.json
      legoworld track check track.json --photos coco/val2017
    """


command.add_command(make_command)


@command.command("check")
@click.argument("track", type=EXISTING_FILE)
@option("--photos")
@options.printing
def check_command(track: Path, photos: Path, out: Output) -> int:
    """Check that every photo of TRACK exists, decodes, and has the size the track says.

    Exit code 1 otherwise.

    \b
    Examples:
      legoworld track check track.json --photos coco/val2017
      legoworld track check track.json --photos coco --json
    """
    from legoworld.api.tracks import track_check
    from legoworld.tracks.track import load_track

    n_images = len(load_track(track).images)
    problems = track_check(track, photos=photos)
    rows: list[Document] = [
        {
            "image_id": p.image.id,
            "file_name": p.image.file_name,
            "status": p.status,
            "found": p.found,
        }
        for p in problems
    ]
    n_good = n_images - len(problems)
    more = [f"... and {len(problems) - 50} more (--json lists them)"] if problems[50:] else []
    good = share(n_good, n_images, "photo", "photos")
    out.show(
        {"images": n_images, "problems": rows},
        [
            *(f"{p.status}: {p.image.file_name} (image {p.image.id}): {p.found}"
              for p in problems[:50]),
            *more,
            f"{good} {word_for(n_good, 'matches', 'match')} the track",
        ],
    )  # fmt: skip
    return 1 if problems else 0
