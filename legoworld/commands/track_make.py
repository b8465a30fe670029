"""`legoworld track make`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output
from legoworld.commands.param_types import COUNT, EXISTING_FILE, TaskChoice, has_track
from legoworld.files import EncodingError, utf8_text
from legoworld.pluralize import plural, share

if TYPE_CHECKING:
    from legoworld.commands.output import Document
    from legoworld.records.track import MadeTrack


@click.command("make")
@option(
    "--task",
    "Task of the track; repeatable, each with its --truth: tracks over the same photos.",
    TaskChoice(has_track),
    required=True,
    multiple=True,
)
@option("--truth truths", options.ANNOTATIONS, multiple=True)
@option(
    "--output",
    "Track file to write; of several tasks the folder of <task>.json.",
    click.Path(path_type=Path),
)
@flag(
    "--any every", "Several tasks: the photos that any truth lists [default: those that all list]."
)
@option("--sample", "Number of images to sample [default: all].", COUNT)
@option("--seed", "RNG seed for sampling, with --sample.")
@option(
    "--images", "Take these images only: a file with one id or file name per line.", EXISTING_FILE
)
@option("--scenes", "Take these scenes of ETH3D's layout only, separated by commas.")
@option("--dataset", "Name of a depth dataset other than ETH3D.")
@option(
    "--photos",
    "Photos whose depth or normals in --truth have the same names, or that statements are about.",
    required=False,
)
@option("--space", "What the depth files hold, with --photos; written to their depth.toml.")
@option("--unit", "m, mm, m/N, sun_rgbd or nyu_raw, with --photos; written to their depth.toml.")
@option("--sign")
@option("--overwrite", "Replace an existing track file.")
@options.printing
def make_command(
    task: tuple[str, ...],
    truths: tuple[Path, ...],
    output: Path,
    every: bool,
    sample: int | None,
    seed: int,
    images: Path | None,
    overwrite: bool,
    out: Output,
    **named: Any,
) -> int:
    """Make a public track from a dataset's annotations.

    A track lists images and categories, never an annotation. The 100 images per task of the
    published reference are not known: a sample is your own, and the track records its seed and
    source. Depth: ETH3D's scenes that are present, another dataset in ETH3D's layout, or, with
    --photos, a folder of .npy, .npz, .pfm, .exr, .png, .pgm or .tiff files named like the photos.
    Normals: with --photos, a folder of .npy, .npz, .exr or .png files, named like the photos or
    X_normal beside X_img or X; --sign or their normals.toml says which way they point.
    Relations: a run of scenes, or with --photos the .jsonl of statements about them, as VSR has it;
    the track carries the questions.

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
    if len(task) != len(truths) or len(set(task)) < len(task):
        raise click.UsageError("pass one --truth for each --task, in the same order")
    if every and len(task) == 1:
        raise click.UsageError("--any is for several --task")
    chosen = _lines(images) if images is not None else None
    takers = _takers(task, named)
    for one in takers if named["photos"] is not None else ():
        _declare(one, truths[task.index(one)], named, out)
    made = _make(
        dict(zip(task, truths, strict=True)),
        output,
        Selection(sample=sample, seed=seed, chosen=chosen, every=every),
        dict.fromkeys(takers, _own_options(named)),
        overwrite=overwrite,
        notice=out.notice,
    )
    infos: dict[str, Document] = {
        path.stem: {"track": str(path), "info": track.info} for path, track in made.items()
    }
    alone = next(iter(infos.values()))
    document: Document = alone if len(infos) == 1 else {"tracks": str(output), "tasks": infos}
    out.show(document, _shown(made, seed))
    return 0


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Which images a track gets. chosen: ids or file names; every: photos that any truth lists."""

    sample: int | None
    seed: int
    chosen: list[str] | None
    every: bool


def _takers(tasks: Sequence[str], given: Mapping[str, object]) -> list[str]:
    """The tasks whose tracks take the given options; click.UsageError for an option of none."""
    from legoworld.track_making.family import load_track_family

    names = [name for name, value in given.items() if value is not None]
    for name in names:
        if not any(name in load_track_family(task).options for task in tasks):
            raise click.UsageError(f"track make: --{name} is not for --task {', '.join(tasks)}")
        declared = any(name in load_track_family(task).declared for task in tasks)
        if declared and given["photos"] is None:
            raise click.UsageError(f"track make: --{name} is for a folder's files, with --photos")
    return [
        task for task in tasks if any(name in load_track_family(task).options for name in names)
    ]


def _declare(task: str, truth: Path, named: Mapping[str, Any], out: Output) -> None:
    from legoworld.track_making.family import load_track_family

    family = load_track_family(task)
    if family.declare is None or not truth.is_dir():
        return
    written = family.declare(truth, {name: named[name] for name in sorted(family.declared)})
    if written is not None:
        name, text = written
        out.notice(f"{truth.name}/{name} now says: {' '.join(text.split())}")


def _own_options(given: Mapping[str, Any]) -> dict[str, Any]:
    """The options that tracks are made with; scenes as a list of names."""
    own = {name: given[name] for name in ("scenes", "dataset", "photos") if given[name] is not None}
    if "scenes" in own:
        own["scenes"] = [name for part in own["scenes"].split(",") if (name := part.strip())]
    return own


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
    from legoworld.track_making.make_track import make_track, make_tracks

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


def _shown(tracks: Mapping[Path, MadeTrack], seed: int) -> Iterator[str]:
    for path, made in tracks.items():
        info = made.info
        drawn = f", drawn with seed {seed}" if info.sample else ""
        of = info.dataset_images or info.source_images
        source = f" of {info.dataset}" if info.dataset else ""
        yield (
            f"{share(len(made.images), of, 'image', 'images')}{source}{drawn}, "
            f"{plural(len(made.categories), 'category', 'categories')} -> {path}"
        )


def _lines(path: Path) -> list[str]:
    """The non-empty lines of a list."""
    try:
        lines = utf8_text(path.read_bytes()).split("\n")
    except EncodingError as error:
        raise click.UsageError(f"--images {path}: {error}") from error
    return [line.strip() for line in lines if line.strip()]
