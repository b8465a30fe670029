"""`legoworld track`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import options
from legoworld.pluralize import counted, share, word_for

if TYPE_CHECKING:
    from legoworld.records.track import MadeTrack
    from legoworld.track_making.making import DepthChoice


@click.command("track", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("action", type=options.Choice(["make", "check"]))
@click.argument("track", required=False, type=options.EXISTING_FILE)
@click.option(
    "--task",
    type=options.Choice(["coco", "coco-masks", "lvis", "eth3d"]),
    help="make: for which task.",
)
@click.option(
    "--truth",
    type=click.Path(path_type=Path, exists=True),
    help="make: COCO or LVIS JSON, or a folder of measured depth.",
)
@click.option("--scenes", help="make: only these scenes of ETH3D's layout, with commas between.")
@click.option("--dataset", help="make: the name of a dataset of depth that is not ETH3D.")
@click.option(
    "--space",
    type=options.Choice(["depth", "disparity", "ray_distance"]),
    help="make, with --photos: what the depth files hold; goes into their depth.toml.",
)
@click.option(
    "--unit", help="make, with --photos: m, mm, m/N, sun_rgbd or nyu_raw; goes into depth.toml."
)
@click.option("--sample", type=click.IntRange(min=1), help="make: images drawn [default: all].")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of it.")
@click.option(
    "--images", type=options.EXISTING_FILE, help="make: only these; one id or file name a line."
)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="make: the track file."
)
@click.option(
    "--photos",
    type=options.EXISTING_FOLDER,
    help="check: the folder of the photos. make: that of depth files named like the photos.",
)
@click.option("--overwrite", is_flag=True, help="make: replace the track file.")
@options.output_options
def command(
    action: str,
    track: Path | None,
    task: str | None,
    truth: Path | None,
    scenes: str | None,
    dataset: str | None,
    space: str | None,
    unit: str | None,
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
    Depth: ETH3D's scenes that are there, another dataset in ETH3D's layout, or, with --photos, a
    folder of .npy, .npz, .pfm, .exr, .png, .pgm or .tiff files named like the photos.

    \b
    Examples:
      legoworld track make --task coco --truth instances_val2017.json --sample 100 -o track.json
      legoworld track make --task eth3d --truth eth3d --scenes courtyard,office -o two.json
      legoworld track make --task eth3d --truth depths --photos photos --space depth --unit mm \\
          --dataset desk -o desk.json
      legoworld track check track.json --photos coco/val2017
    """
    if action == "make":
        if task is None or truth is None or output is None or track is not None:
            raise click.UsageError("track make needs --task, --truth and -o, and no TRACK")
        if images is not None and sample is not None:
            raise click.UsageError("--images and --sample are two ways to choose: pass one")
        chosen = _lines(images) if images is not None else None
        depth = {"--scenes": scenes, "--dataset": dataset, "--space": space, "--unit": unit}
        _refuse_depth_options(task, {**depth, "--photos": photos}, with_photos=photos is not None)
        if photos is not None:
            _declare(truth, space, unit, quiet=quiet)
        made = _make(
            task,
            truth,
            output,
            sample,
            seed,
            chosen,
            _depth_choice(scenes, dataset, photos),
            overwrite=overwrite,
            notice=options.notifier(quiet),
        )
        return _show(made, output, seed, as_json=as_json)
    if track is None or photos is None:
        raise click.UsageError("track check needs a TRACK and --photos")
    options.refuse_given(
        ["task", "truth", "scenes", "dataset", "space", "unit", "sample", "seed", "images",
         "output", "overwrite"],
        "is for track make, not for track check",
    )  # fmt: skip
    return _check(track, photos, as_json=as_json)


def _refuse_depth_options(task: str, given: Mapping[str, object], *, with_photos: bool) -> None:
    """Wrong usage: options of depth without a folder of depth."""
    for option, value in given.items():
        if value is not None and task != "eth3d":
            raise click.UsageError(f"track make: {option} is not for --task {task}")
        if value is not None and option in ("--space", "--unit") and not with_photos:
            raise click.UsageError(f"track make: {option} is for depth files, with --photos")


def _declare(truth: Path, space: str | None, unit: str | None, *, quiet: bool) -> None:
    from legoworld.evaluation.depth.integer_units import UNITS, is_unit
    from legoworld.track_making.depth_folders import declare

    if unit is not None and not is_unit(unit) and unit != "px":
        raise click.UsageError(f"--unit {unit!r} is not one of {UNITS}")
    if truth.is_dir() and (written := declare(truth, space, unit)):
        options.notifier(quiet)(f"{truth.name}/depth.toml now says: {' '.join(written.split())}")


def _depth_choice(scenes: str | None, dataset: str | None, photos: Path | None) -> DepthChoice:
    from legoworld.track_making.making import DepthChoice

    named = [name.strip() for name in scenes.split(",")] if scenes is not None else None
    return DepthChoice(
        scenes=[name for name in named if name] if named is not None else None,
        dataset=dataset,
        photos=photos,
    )


def _make(
    task: str,
    truth: Path,
    output: Path,
    sample: int | None,
    seed: int,
    chosen: list[str] | None,
    depth: DepthChoice,
    *,
    overwrite: bool,
    notice: Callable[[str], None],
) -> MadeTrack:
    from legoworld.errors import UsageError
    from legoworld.track_making.making import make_track

    if output.exists() and not overwrite:
        raise UsageError(
            f"{output.name} is there already",
            expected="a new file",
            next_step="choose another -o, or pass --overwrite",
        )
    return make_track(
        task, truth, output, sample=sample, seed=seed, chosen=chosen, depth=depth, notice=notice
    )


def _show(made: MadeTrack, output: Path, seed: int, *, as_json: bool) -> int:
    info = made.info
    if as_json:
        options.print_json({"track": str(output), "info": info})
        return 0
    drawn = f", drawn with seed {seed}" if info.sample else ""
    of = info.dataset_images or info.source_images
    source = f" of {info.dataset}" if info.dataset else ""
    click.echo(
        f"{share(len(made.images), of, 'image', 'images')}{source}{drawn}, "
        f"{counted(len(made.categories), 'category', 'categories')} -> {output}"
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
    from legoworld.readouts.pictures import read_photo
    from legoworld.track_making.making import check_photos
    from legoworld.tracks.track import load_track

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
        n_good = len(images) - len(problems)
        good = share(n_good, len(images), "photo", "photos")
        click.echo(f"{good} {word_for(n_good, 'is', 'are')} as the track says")
    return 1 if problems else 0
