"""`legoworld readout`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.progress import shown_progress
from legoworld.commands.remote import PlaceType
from legoworld.commands.run_text import show_run
from legoworld.remote import Place
from legoworld.tracks.dataset_versions import dataset_of

if TYPE_CHECKING:
    from legoworld.scene.blender_process import BlenderProcess


@click.command("readout", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("scenes", required=False, type=PlaceType(exists=True))
@click.option(
    "--task",
    required=True,
    type=options.TaskChoice(),
    help="Task to read out.",
)
@click.option(
    "--track", type=options.EXISTING_FILE, help="Track file (images); COCO image-info JSON."
)
@click.option(
    "-o", "--output", type=PlaceType(exists=False), help="Run folder to write, or its URL."
)
@click.option("--workers", type=click.IntRange(min=1), help="Blender processes [default: cores].")
@options.source
@options.caching
@click.option("--require-frozen", is_flag=True, help="Refuse scenes without a frozen.json.")
@click.option(
    "--limit", type=click.IntRange(min=1), help="Read the first N images only (partial run)."
)
@click.option(
    "--image-id", "image_ids", multiple=True, type=int, help="Read this image only; repeatable."
)
@click.option(
    "--shard", type=options.ShardType(), help="Read every n-th image only, starting at the i-th."
)
@options.engine
@click.option(
    "--images-per-file",
    type=click.IntRange(min=1),
    metavar="N",
    help="Boxes and masks: write predictions/00000.jsonl, ... of N images each, for very large "
    "tracks.",
)
@click.option(
    "--max-side",
    type=click.IntRange(min=1),
    help="Depth only: longest side of the rendered image, in pixels.",
)
@click.option("--no-render", is_flag=True, help="Bench only: R without A, no Cycles render.")
@click.option("--render-noise", is_flag=True, help="Bench only: render a second seed and compare.")
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
    no_render: bool,
    render_noise: bool,
    overwrite: bool,
    fail_fast: bool,
    time_limit: float,
    memory_limit: float,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Read COCO boxes or masks, LVIS masks, depth or bench submissions out of frozen SCENES.

    An image of the track is read from SCENES/<file_name without extension>/scene.blend. Without
    --track every scene folder is an image. Without SCENES the shipped examples are read. Re-run the
    same command to resume. Exit code 1 when a scene could not be read.

    \b
    Examples:
      legoworld readout --task coco
      legoworld readout scenes --task coco --track track.json -o runs/coco --workers 8
      legoworld readout scenes --task eth3d --track eth3d.json -o runs/depth --max-side 1024
      legoworld readout submissions --task bench --track bench/public/track.json -o runs/mine
    """
    started = _started_ahead(
        time_limit,
        memory_limit,
        wanted=no_cache and source == "blend" and engine == "local" and not isinstance(scenes, str),
    )
    from legoworld.api.readout import default_output, readout
    from legoworld.shipped.examples import shipped_examples

    notice = options.notifier(quiet)
    if scenes is None:
        scenes, shipped_track = shipped_examples(dataset_of(task))
        track = track or shipped_track
        output = output or Path("legoworld-runs") / f"examples-{task}"
        notice(f"no SCENES given: reading the {task} examples that ship with legoworld")
    output = output or default_output(scenes, task)
    with shown_progress("scene", quiet=quiet) as listener:
        run = readout(
            scenes,
            output,
            task=task,
            track=track,
            source=source,
            workers=workers,
            engine=engine,
            cache=options.cache_choice(cache, no_cache),
            require_frozen=require_frozen,
            limit=limit,
            image_ids=image_ids,
            shard=shard,
            images_per_file=images_per_file,
            max_side=max_side,
            render=not no_render,
            render_noise=render_noise,
            overwrite=overwrite,
            fail_fast=fail_fast,
            time_limit_s=time_limit,
            memory_limit_gib=memory_limit,
            listener=replace(listener, trace=options.tracer(verbose)),
            started=started,
        )
    if as_json:
        options.print_json(run.to_dict())
    else:
        show_run(run, quiet=quiet, verbose=verbose)
    return exit_codes.DONE if run.complete else exit_codes.INCOMPLETE


def _started_ahead(
    time_limit_s: float, memory_limit_gib: float, *, wanted: bool
) -> BlenderProcess | None:
    """A Blender process that imports bpy while this process imports its own modules.

    It ends with this process. None unless wanted: with a snapshot cache Blender may not be needed.
    """
    if not wanted:
        return None
    from legoworld.scene.blender_process import BlenderProcess, Limits

    limits = Limits(time_s=time_limit_s, memory_bytes=int(memory_limit_gib * 2**30))
    process = BlenderProcess(limits)
    click.get_current_context().call_on_close(process.close)
    process.start()
    return process
