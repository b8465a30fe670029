"""`legoworld track make`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import options
from legoworld.files import EncodingError, utf8_text
from legoworld.pluralize import counted, share

if TYPE_CHECKING:
    from legoworld.records.track import MadeTrack


@click.command("make", context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--task",
    required=True,
    type=options.TaskChoice(options.has_track),
    help="Task of the track.",
)
@click.option(
    "--truth",
    required=True,
    type=click.Path(path_type=Path, exists=True),
    help="COCO or LVIS annotations (JSON), or a folder of measured depth.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="Track file to write.",
)
@click.option(
    "--sample", type=click.IntRange(min=1), help="Number of images to sample [default: all]."
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="RNG seed for sampling, with --sample.",
)
@click.option(
    "--images",
    type=options.EXISTING_FILE,
    help="Take these images only: a file with one id or file name per line.",
)
@click.option("--scenes", help="Take these scenes of ETH3D's layout only, separated by commas.")
@click.option("--dataset", help="Name of a depth dataset other than ETH3D.")
@click.option(
    "--photos",
    type=options.EXISTING_FOLDER,
    help="Photos whose depth files in --truth have the same names.",
)
@click.option(
    "--space",
    type=options.Choice(["depth", "disparity", "ray_distance"]),
    help="What the depth files hold, with --photos; written to their depth.toml.",
)
@click.option(
    "--unit",
    help="m, mm, m/N, sun_rgbd or nyu_raw, with --photos; written to their depth.toml.",
)
@click.option("--overwrite", is_flag=True, help="Replace an existing track file.")
@options.output_options
def make_command(
    task: str,
    truth: Path,
    output: Path,
    sample: int | None,
    seed: int,
    images: Path | None,
    scenes: str | None,
    dataset: str | None,
    photos: Path | None,
    space: str | None,
    unit: str | None,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Make a public track from a dataset's annotations.

    A track lists images and categories, never an annotation. The 100 images per task of the
    published reference are not known: a sample is your own, and the track records its seed and
    source. Depth: ETH3D's scenes that are present, another dataset in ETH3D's layout, or, with
    --photos, a folder of .npy, .npz, .pfm, .exr, .png, .pgm or .tiff files named like the photos.

    \b
    Examples:
      legoworld track make --task coco --truth instances_val2017.json --sample 100 -o track.json
      legoworld track make --task eth3d --truth eth3d --scenes courtyard,office -o two.json
      legoworld track make --task eth3d --truth depths --photos photos --space depth --unit mm \\
          --dataset desk -o desk.json
    """
    if sample is None:
        options.refuse_given(["seed"], "is for --sample")
    if images is not None and sample is not None:
        raise click.UsageError("--images and --sample exclude each other: pass one")
    chosen = _lines(images) if images is not None else None
    named = {"scenes": scenes, "dataset": dataset, "space": space, "unit": unit, "photos": photos}
    _refuse_others_options(task, named)
    if photos is not None:
        _declare(truth, space, unit, quiet=quiet)
    made = _make(
        task,
        truth,
        output,
        sample,
        seed,
        chosen,
        _own_options(scenes, dataset=dataset, photos=photos),
        overwrite=overwrite,
        notice=options.notifier(quiet),
    )
    return _show(made, output, seed, as_json=as_json)


def _refuse_others_options(task: str, given: Mapping[str, object]) -> None:
    """Raise click.UsageError for an option that the task's tracks do not take."""
    from legoworld.track_making.family import track_of

    for name, value in given.items():
        if value is not None and name not in track_of(task).options:
            raise click.UsageError(f"track make: --{name} is not for --task {task}")
        if value is not None and name in ("space", "unit") and given["photos"] is None:
            raise click.UsageError(f"track make: --{name} is for depth files, with --photos")


def _declare(truth: Path, space: str | None, unit: str | None, *, quiet: bool) -> None:
    from legoworld.evaluation.depth.integer_units import UNITS, is_unit
    from legoworld.track_making.depth_folders import declare

    if unit is not None and not is_unit(unit) and unit != "px":
        raise click.UsageError(f"--unit {unit!r} is not one of {UNITS}")
    if truth.is_dir() and (written := declare(truth, space, unit)):
        options.notifier(quiet)(f"{truth.name}/depth.toml now says: {' '.join(written.split())}")


def _own_options(scenes: str | None, **given: object) -> dict[str, object]:
    """The options that were given; scenes as a list of names."""
    if scenes is not None:
        given["scenes"] = [name for part in scenes.split(",") if (name := part.strip())]
    return {name: value for name, value in given.items() if value is not None}


def _make(
    task: str,
    truth: Path,
    output: Path,
    sample: int | None,
    seed: int,
    chosen: list[str] | None,
    own: Mapping[str, object],
    *,
    overwrite: bool,
    notice: Callable[[str], None],
) -> MadeTrack:
    from legoworld.errors import UsageError
    from legoworld.track_making.making import make_track

    if output.exists() and not overwrite:
        raise UsageError(
            f"{output.name} already exists",
            expected="a new file",
            next_step="choose another -o, or pass --overwrite",
        )
    return make_track(
        task, truth, output, sample=sample, seed=seed, chosen=chosen, options=own, notice=notice
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
    """The non-empty lines of a list."""
    try:
        lines = utf8_text(path.read_bytes()).split("\n")
    except EncodingError as error:
        raise click.UsageError(f"--images {path}: {error}") from error
    return [line.strip() for line in lines if line.strip()]
