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
from legoworld.commands.run_text import show_runs
from legoworld.remote import Place
from legoworld.tracks.dataset_versions import dataset_of

if TYPE_CHECKING:
    from legoworld.scene.blender_process import BlenderProcess


@click.command("readout", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("scenes", required=False, type=PlaceType(exists=True))
@click.option(
    "--task",
    "tasks",
    required=True,
    multiple=True,
    type=options.TaskChoice(),
    help="Task to read out; repeatable: each scene is then read once for all tasks.",
)
@click.option(
    "--track",
    type=click.Path(path_type=Path, exists=True),
    help="Track file (images), COCO image-info JSON; or a folder with <task>.json of each task.",
)
@click.option(
    "-o",
    "--output",
    type=PlaceType(exists=False),
    help="Run folder to write, or its URL; of several tasks the folder of their run folders.",
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
    tasks: tuple[str, ...],
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
    --track every scene folder is an image. Several --task write RUNS/<task> for each, byte for byte
    what one alone writes. Without SCENES the shipped examples are read. Re-run the
    same command to resume. Exit code 1 when a scene could not be read.

    \b
    Examples:
      legoworld readout --task coco
      legoworld readout scenes --task coco --track track.json -o runs/coco --workers 8
      legoworld readout scenes --task coco --task lvis --task eth3d --track tracks -o runs
      legoworld readout submissions --task bench --track bench/public/track.json -o runs/mine
    """
    started = _started_ahead(
        time_limit,
        memory_limit,
        wanted=no_cache and source == "blend" and engine == "local" and not isinstance(scenes, str),
    )
    from legoworld.api.readout import Run, default_output, readout
    from legoworld.api.settings import Tracks
    from legoworld.shipped.examples import shipped_examples

    notice = options.notifier(quiet)
    only = tasks[0] if len(tasks) == 1 else None
    tracks: Tracks = track
    if scenes is None:
        shipped = {task: shipped_examples(dataset_of(task)) for task in tasks}
        scenes = shipped[tasks[0]][0]
        tracks = track or {task: own for task, (_, own) in shipped.items()}
        output = output or Path("legoworld-runs") / (f"examples-{only}" if only else "examples")
        named = f"the {only} examples" if only else "the examples"
        notice(f"no SCENES given: reading {named} that ship with legoworld")
    output = output or default_output(scenes, only)
    with shown_progress("scene" if only else "answer", quiet=quiet) as listener:
        found = readout(
            scenes,
            output,
            task=only or list(tasks),
            track=tracks,
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
        options.print_json(found.to_dict())
    runs = {found.summary.task: found} if isinstance(found, Run) else found
    if not as_json:
        show_runs(runs, quiet=quiet, verbose=verbose)
    complete = all(run.complete for run in runs.values())
    return exit_codes.DONE if complete else exit_codes.INCOMPLETE


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
