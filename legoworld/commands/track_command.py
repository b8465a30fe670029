"""`legoworld track`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output
from legoworld.commands.param_types import COUNT, EXISTING_FILE, TaskChoice, has_track
from legoworld.files import EncodingError, utf8_text
from legoworld.pluralize import plural, share, word_for

if TYPE_CHECKING:
    from legoworld.commands.output import Document
    from legoworld.records.track import MadeTrack


@options.group("track")
def command() -> None:
    """Make a public track (a list of images and categories), or check one against its photos.

    \b
    Examples:
      legoworld track make --task coco --truth instances_val2017.json --sample 100 -o track.json
      legoworld track check track.json --photos coco/val2017
    """


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


@command.command("make")
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
@option("--scenes scene_names", "Take these scenes of ETH3D's layout only, separated by commas.")
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
    scene_names: str | None,
    out: Output,
    **given: Any,
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
    from legoworld.api.tracks import track_make

    if sample is None:
        options.refuse_given(["seed"], "is for --sample")
    if len(task) != len(truths) or len(set(task)) < len(task):
        raise click.UsageError("pass one --truth for each --task, in the same order")
    if every and len(task) == 1:
        raise click.UsageError("--any is for several --task")
    made = track_make(
        output,
        truth=truths[0] if len(task) == 1 else dict(zip(task, truths, strict=True)),
        task=task[0] if len(task) == 1 else None,
        every=every,
        sample=sample,
        seed=seed,
        images=None if images is None else _lines(images),
        scene_names=None if scene_names is None else _names(scene_names),
        listener=out.listener(),
        **given,
    )
    files = {name: output / f"{name}.json" if len(task) > 1 else output for name in made}
    infos: dict[str, Document] = {
        name: {"track": str(files[name]), "info": track.info} for name, track in made.items()
    }
    alone = next(iter(infos.values()))
    document: Document = alone if len(infos) == 1 else {"tracks": str(output), "tasks": infos}
    out.show(document, _track_lines({files[name]: one for name, one in made.items()}, seed))
    return 0


def _track_lines(tracks: Mapping[Path, MadeTrack], seed: int) -> Iterator[str]:
    for path, made in tracks.items():
        info = made.info
        drawn = f", drawn with seed {seed}" if info.sample else ""
        of = info.dataset_images or info.source_images
        source = f" of {info.dataset}" if info.dataset else ""
        yield (
            f"{share(len(made.images), of, 'image', 'images')}{source}{drawn}, "
            f"{plural(len(made.categories), 'category', 'categories')} -> {path}"
        )


def _names(text: str) -> list[str]:
    return [name for part in text.split(",") if (name := part.strip())]


def _lines(path: Path) -> list[str]:
    """The non-empty lines of a list."""
    try:
        lines = utf8_text(path.read_bytes()).split("\n")
    except EncodingError as error:
        raise click.UsageError(f"--images {path}: {error}") from error
    return [line.strip() for line in lines if line.strip()]
