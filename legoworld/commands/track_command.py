"""`legoworld track`."""

from __future__ import annotations

from pathlib import Path

import click

from legoworld.commands import options


@click.command("track", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("action", type=click.Choice(["make", "check"]))
@click.argument("track", required=False, type=options.EXISTING_FILE)
@click.option("--task", type=click.Choice(["coco", "lvis", "eth3d"]), help="make: for which task.")
@click.option(
    "--truth",
    type=click.Path(path_type=Path, exists=True),
    help="make: COCO or LVIS JSON, or ETH3D's folder.",
)
@click.option("--sample", type=click.IntRange(min=1), help="make: images drawn [default: all].")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of it.")
@click.option(
    "--images", type=options.EXISTING_FILE, help="make: only these; one id or file name a line."
)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="make: the track file."
)
@click.option("--photos", type=options.EXISTING_FOLDER, help="check: the folder of the photos.")
@click.option("--overwrite", is_flag=True, help="make: replace the track file.")
@options.output_options
def command(
    action: str,
    track: Path | None,
    task: str | None,
    truth: Path | None,
    sample: int | None,
    seed: int,
    images: Path | None,
    output: Path | None,
    photos: Path | None,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Make a public TRACK from a dataset's annotations, or check one against its photos.

    A track lists images and categories, never an annotation. The published reference's 100 images
    a task are not known: a sample here is your own, and its seed and source are on record in it.
    check: every photo is there, decodes, and has the size the track says. Exit code 1 otherwise.

    \b
    Examples:
      legoworld track make --task coco --truth instances_val2017.json --sample 100 -o track.json
      legoworld track make --task lvis --truth lvis_v1_val.json --images ids.txt -o track.json
      legoworld track make --task eth3d --truth eth3d -o eth3d.json
      legoworld track check track.json --photos coco/val2017
    """
    if action == "make":
        if task is None or truth is None or output is None or track is not None:
            raise click.UsageError("track make needs --task, --truth and -o, and no TRACK")
        if images is not None and sample is not None:
            raise click.UsageError("--images and --sample are two ways to choose: pass one")
        chosen = _lines(images) if images is not None else None
        return _make(
            task, truth, output, sample, seed, chosen, overwrite=overwrite, as_json=as_json
        )
    if track is None or photos is None:
        raise click.UsageError("track check needs a TRACK and --photos")
    return _check(track, photos, as_json=as_json)


def _make(
    task: str,
    truth: Path,
    output: Path,
    sample: int | None,
    seed: int,
    chosen: list[str] | None,
    *,
    overwrite: bool,
    as_json: bool,
) -> int:
    from legoworld.errors import UsageError
    from legoworld.track_making import make_track

    if output.exists() and not overwrite:
        raise UsageError(
            f"{output.name} is there already",
            expected="a new file",
            next_step="choose another -o, or pass --overwrite",
        )
    document = make_track(task, truth, output, sample=sample, seed=seed, chosen=chosen)
    if as_json:
        options.print_json({"track": str(output), "info": document["info"]})
    else:
        info = document["info"]
        drawn = f", drawn with seed {seed}" if sample else ""
        click.echo(
            f"{len(document['images'])} of {info['source_images']} images{drawn}, "
            f"{len(document['categories'])} categories -> {output}"
        )
    return 0


def _lines(path: Path) -> list[str]:
    """The lines of a list that are not empty."""
    try:
        lines = path.read_text(encoding="utf-8").split("\n")
    except UnicodeDecodeError as error:
        raise click.UsageError(f"--images {path.name} is not a text file") from error
    return [line.strip() for line in lines if line.strip()]


def _check(track: Path, photos: Path, *, as_json: bool) -> int:
    from legoworld.pictures import read_photo
    from legoworld.track import load_track
    from legoworld.track_making import check_photos

    def size_of(path: Path) -> tuple[int, int]:
        height, width = read_photo(path).shape[:2]
        return width, height

    images = load_track(track).images
    problems = check_photos(images, photos, size_of)
    if as_json:
        rows = [
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
        click.echo(f"{len(images) - len(problems)} of {len(images)} photos are as the track says")
    return 1 if problems else 0
