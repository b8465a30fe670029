"""`legoworld readout`."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Literal

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.places import PlaceType, written_at
from legoworld.commands.progress import shown_progress
from legoworld.commands.run_text import show_run
from legoworld.places import Place

if TYPE_CHECKING:
    from legoworld.scene_names import Stranger
    from legoworld.track import Track


@click.command("readout", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("scenes", required=False, type=PlaceType(exists=True))
@click.option(
    "--task",
    required=True,
    type=options.Choice(["coco", "coco-masks", "lvis", "eth3d"]),
    help="What to read.",
)
@click.option("--track", type=options.EXISTING_FILE, help="The images; COCO image-info JSON.")
@click.option(
    "-o", "--output", type=PlaceType(exists=False), help="The run folder to write, or its URL."
)
@click.option("--workers", type=click.IntRange(min=1), help="Blender processes [default: cores].")
@click.option(
    "--source",
    type=options.Choice(["blend", "glb"]),
    default="blend",
    show_default=True,
    help="Which file of a scene is read.",
)
@options.caching
@click.option("--require-frozen", is_flag=True, help="Refuse scenes without a frozen.json.")
@click.option("--limit", type=click.IntRange(min=1), help="Only the first N images (partial run).")
@click.option("--image-id", "image_ids", multiple=True, type=int, help="Only this image; repeat.")
@click.option("--shard", type=options.ShardType(), help="Only every n-th image, from the i-th on.")
@options.engine
@click.option(
    "--images-per-file",
    type=click.IntRange(min=1),
    metavar="N",
    help="Boxes and masks: predictions/00000.jsonl, ... of N images each, for very large tracks.",
)
@click.option("--max-side", type=click.IntRange(min=1), help="Depth only: render smaller.")
@click.option("--overwrite", is_flag=True, help="Delete the results of an earlier run first.")
@click.option("--fail-fast", is_flag=True, help="Stop at the first scene that cannot be read.")
@options.limits
@options.output_options
def command(
    scenes: Place | None,
    task: str,
    track: Path | None,
    output: Place | None,
    workers: int | None,
    source: Literal["blend", "glb"],
    cache: Path | None,
    no_cache: bool,
    require_frozen: bool,
    limit: int | None,
    image_ids: tuple[int, ...],
    shard: tuple[int, int] | None,
    engine: Literal["local", "ray"],
    images_per_file: int | None,
    max_side: int | None,
    overwrite: bool,
    fail_fast: bool,
    time_limit: float,
    memory_limit: float,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Read COCO boxes or masks, LVIS masks or depth out of frozen SCENES.

    An image of the track is read from SCENES/<file_name without extension>/scene.blend. Without
    --track every scene folder is an image. Without SCENES the shipped examples are read. The same
    command again goes on where a run stopped. Exit code 1 when some scene could not be read.

    \b
    Examples:
      legoworld readout --task coco
      legoworld readout scenes --task coco --track track.json -o runs/coco --workers 8
      legoworld readout scenes --task coco -o shards/3 --shard 3/16
      legoworld readout scenes --task eth3d --track eth3d.json -o runs/depth --max-side 1024
    """
    from legoworld.commands.shipped import shipped_examples
    from legoworld.readouts.tasks import protocol
    from legoworld.running.image_record import ImageOptions
    from legoworld.running.readout_run import RunRequest, run_readout, shard_images
    from legoworld.track import load_track, serves, track_of_folder

    notice = options.notifier(quiet)
    if max_side is not None and task != "eth3d":
        raise click.UsageError(
            "--max-side is for depth: boxes and masks are read at the image's own size"
        )
    if images_per_file is not None and task == "eth3d":
        raise click.UsageError(
            "--images-per-file is for boxes and masks: depth has a file an image already"
        )
    if scenes is None:
        scenes, shipped_track = shipped_examples(task)
        track = track or shipped_track
        output = output or Path("legoworld-runs") / f"examples-{task}"
        notice(f"no SCENES given: reading the {task} examples that ship with legoworld")
    output = output or Path("legoworld-runs") / f"{_name_of(scenes) or 'scenes'}-{task}"
    images = load_track(track) if track else track_of_folder(scenes)
    if not serves(images, task):
        raise click.UsageError(
            f"the track is made for {images.made_for}, not for {task}: make one with "
            f"`legoworld track make --task {task}`"
        )
    _refuse_output_in_a_scene(output, scenes)
    request = RunRequest(
        image_options=ImageOptions(
            scenes=scenes if isinstance(scenes, str) else scenes.absolute(),
            run=Path(),
            protocol=protocol(task, images.vocabulary),
            source=source,
            cache=options.chosen_cache(cache, no_cache),
            require_frozen=require_frozen,
            max_side=max_side,
            threads=1,
        ),
        track=images,
        engine=engine,
        workers=workers or options.engine_cores(engine),
        limits=options.chosen_limits(time_limit, memory_limit),
        overwrite=overwrite,
        limit=limit,
        image_ids=image_ids,
        shard=shard,
        fail_fast=fail_fast,
        images_per_file=images_per_file,
    )
    with written_at(output, last="run.json", overwrite=overwrite) as folder:
        here = replace(request.image_options, run=folder.absolute())
        request = replace(request, image_options=here)
        total = len(shard_images(request))
        with shown_progress(total, "scene", quiet=quiet) as shown:
            result = run_readout(request, progress=shown.row, notice=shown.say, kept=shown.kept)
    found = _strangers(scenes, images) if track and shard is None else []
    if as_json:
        options.print_json(
            {
                "run": str(output),
                "summary": result.summary,
                "rows": result.rows,
                "unmatched_folders": [asdict(stranger) for stranger in found],
            }
        )
    else:
        show_run(result, output, found, quiet=quiet, verbose=verbose)
    complete = result.summary["coverage"]["ok"] == len(result.rows)
    return exit_codes.DONE if complete else exit_codes.INCOMPLETE


def _strangers(scenes: Place, track: Track) -> list[Stranger]:
    """Scene folders that match no image of a track; of a folder of this machine only."""
    from legoworld.errors import CatalogError
    from legoworld.scene_names import strangers
    from legoworld.track import track_of_folder

    if not isinstance(scenes, Path):
        return []
    try:
        folders = {image.scene for image in track_of_folder(scenes).images}
    except CatalogError:
        return []  # no scene at all: every row of the run says so
    known = [image.scene for image in track.images]
    return strangers(folders, known, [name for name in known if name not in folders])


def _name_of(scenes: Place) -> str:
    return scenes.resolve().name if isinstance(scenes, Path) else PurePosixPath(scenes).name


def _refuse_output_in_a_scene(output: Place, scenes: Place) -> None:
    """UsageError when a folder is, or is below, a scene folder of SCENES."""
    if not isinstance(output, Path) or not isinstance(scenes, Path):
        return
    top, below = scenes.resolve(), output.resolve()
    around = [p for p in (below, *below.parents) if p.is_relative_to(top)]
    if any((p / name).is_file() for p in around for name in ("scene.blend", "scene.glb")):
        raise click.UsageError(f"-o {output} lies in a scene, which a readout never writes into")
