"""`legoworld track make`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.commands import options
from legoworld.files import EncodingError, utf8_text
from legoworld.pluralize import counted, share
from legoworld.records.base import Storable

if TYPE_CHECKING:
    from legoworld.records.track import MadeTrack


@click.command("make", context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--task",
    "tasks",
    required=True,
    multiple=True,
    type=options.TaskChoice(options.has_track),
    help="Task of the track; repeatable, each with its --truth: tracks over the same photos.",
)
@click.option(
    "--truth",
    "truths",
    required=True,
    multiple=True,
    type=click.Path(path_type=Path, exists=True),
    help="COCO or LVIS annotations (JSON), or a folder of measured depth.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="Track file to write; of several tasks the folder of <task>.json.",
)
@click.option(
    "--any",
    "every",
    is_flag=True,
    help="Several tasks: the photos that any truth lists [default: those that all list].",
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
    tasks: tuple[str, ...],
    truths: tuple[Path, ...],
    output: Path,
    every: bool,
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
      legoworld track make --task coco --truth coco.json --task lvis --truth lvis.json -o tracks
      legoworld track make --task eth3d --truth eth3d --scenes courtyard,office -o two.json
      legoworld track make --task eth3d --truth depths --photos photos --space depth --unit mm \\
          --dataset desk -o desk.json
    """
    if sample is None:
        options.refuse_given(["seed"], "is for --sample")
    if images is not None and sample is not None:
        raise click.UsageError("--images and --sample exclude each other: pass one")
    if len(tasks) != len(truths) or len(set(tasks)) < len(tasks):
        raise click.UsageError("pass one --truth for each --task, in the same order")
    if every and len(tasks) == 1:
        raise click.UsageError("--any is for several --task")
    chosen = _lines(images) if images is not None else None
    named = {"scenes": scenes, "dataset": dataset, "space": space, "unit": unit, "photos": photos}
    takers = _takers(tasks, named)
    if photos is not None:
        for task in takers:
            _declare(truths[tasks.index(task)], space, unit, quiet=quiet)
    made = _make(
        dict(zip(tasks, truths, strict=True)),
        output,
        Selection(sample=sample, seed=seed, chosen=chosen, every=every),
        dict.fromkeys(takers, _own_options(scenes, dataset=dataset, photos=photos)),
        overwrite=overwrite,
        notice=options.notifier(quiet),
    )
    return _show(made, output, seed, as_json=as_json)


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Which images a track gets. chosen: ids or file names; every: photos that any truth lists."""

    sample: int | None
    seed: int
    chosen: list[str] | None
    every: bool


def _takers(tasks: Sequence[str], given: Mapping[str, object]) -> list[str]:
    """The tasks whose tracks take the given options; click.UsageError for an option of none."""
    from legoworld.track_making.family import track_of

    names = [name for name, value in given.items() if value is not None]
    for name in names:
        if not any(name in track_of(task).options for task in tasks):
            raise click.UsageError(f"track make: --{name} is not for --task {', '.join(tasks)}")
        if name in ("space", "unit") and given["photos"] is None:
            raise click.UsageError(f"track make: --{name} is for depth files, with --photos")
    return [task for task in tasks if any(name in track_of(task).options for name in names)]


def _declare(truth: Path, space: str | None, unit: str | None, *, quiet: bool) -> None:
    from legoworld.evaluation.depth.integer_units import UNITS, is_unit
    from legoworld.track_making.depth import declare

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
    truths: Mapping[str, Path],
    output: Path,
    selection: Selection,
    own: Mapping[str, Mapping[str, object]],
    *,
    overwrite: bool,
    notice: Callable[[str], None],
) -> dict[Path, MadeTrack]:
    """The tracks by their files."""
    from legoworld.errors import UsageError
    from legoworld.track_making.making import make_track, make_tracks

    several = len(truths) > 1
    files = {task: output / f"{task}.json" if several else output for task in truths}
    for path in files.values():
        if path.exists() and not overwrite:
            raise UsageError(
                f"{path.name} already exists",
                expected="a new file",
                next_step="choose another -o, or pass --overwrite",
            )
    sample, seed, chosen = selection.sample, selection.seed, selection.chosen
    if several:
        tracks = make_tracks(
            truths, output, sample=sample, seed=seed, chosen=chosen, every=selection.every,
            options=own, notice=notice,
        )  # fmt: skip
    else:
        tracks = {
            task: make_track(
                task, truth, output, sample=sample, seed=seed, chosen=chosen,
                options=own.get(task), notice=notice,
            )
            for task, truth in truths.items()
        }  # fmt: skip
    return {files[task]: track for task, track in tracks.items()}


def _show(tracks: Mapping[Path, MadeTrack], output: Path, seed: int, *, as_json: bool) -> int:
    if as_json:
        infos: dict[str, dict[str, Storable]] = {
            path.stem: {"track": str(path), "info": t.info} for path, t in tracks.items()
        }
        alone = next(iter(infos.values()))
        options.print_json(alone if len(infos) == 1 else {"tracks": str(output), "tasks": infos})
        return 0
    for path, made in tracks.items():
        info = made.info
        drawn = f", drawn with seed {seed}" if info.sample else ""
        of = info.dataset_images or info.source_images
        source = f" of {info.dataset}" if info.dataset else ""
        click.echo(
            f"{share(len(made.images), of, 'image', 'images')}{source}{drawn}, "
            f"{counted(len(made.categories), 'category', 'categories')} -> {path}"
        )
    return 0


def _lines(path: Path) -> list[str]:
    """The non-empty lines of a list."""
    try:
        lines = utf8_text(path.read_bytes()).split("\n")
    except EncodingError as error:
        raise click.UsageError(f"--images {path}: {error}") from error
    return [line.strip() for line in lines if line.strip()]
