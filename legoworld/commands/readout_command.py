"""`legoworld readout`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output, print_json
from legoworld.commands.param_types import (
    COUNT,
    EXISTING,
    EXISTING_SCENES,
    PLACE,
    Choice,
    ShardType,
    TaskChoice,
)
from legoworld.commands.progress import shown_progress
from legoworld.commands.run_text import show_runs
from legoworld.remote import Place
from legoworld.tracks.vocabulary import find_dataset

if TYPE_CHECKING:
    from legoworld.api.readout import ReadoutOptions
    from legoworld.scene.blender_process import BlenderProcess


@click.command("readout")
@click.argument("scenes", required=False, type=EXISTING_SCENES)
@option(
    "--task",
    "Task to read out; repeatable: each scene is then read once for all tasks.",
    TaskChoice(),
    required=True,
    multiple=True,
)
@option(
    "--track",
    "Track file (images), COCO image-info JSON; or a folder with <task>.json of each task.",
    EXISTING,
)
@option(
    "--output",
    "Run folder to write, or its URL; of several tasks the folder of their run folders.",
    PLACE,
    required=False,
)
@option("--workers")
@option("--source")
@options.cache
@option("--require-frozen")
@option("--limit")
@option("--image-id")
@option("--shard", "Read every n-th image only, starting at the i-th.", ShardType())
@option("--engine")
@option("--images-per-file")
@option("--max-side", "Depth and normals: longest side of the rendered image, in pixels.", COUNT)
@option("--sky", "Panoptic, semantic: category of pixels without geometry [default: VOID].")
@option(
    "--vocabulary",
    "Boxes and masks: task whose categories and label rules are taken [default: its own].",
    TaskChoice(lambda task: task.family.labelled),
)
@option(
    "--variant",
    "Normals: of the triangle's plane, or interpolated as the scene is shaded.",
    Choice(["geometric", "shading"]),
)
@option("--no-render", "Bench only: R without A, no Cycles render.")
@flag("--render-noise", "Bench only: render a second seed and compare.")
@option("--overwrite")
@flag("--fail-fast", "Stop at the first scene that cannot be read.")
@options.limits
@options.printing
def command(
    scenes: Place | None,
    task: tuple[str, ...],
    output: Place | None,
    out: Output,
    **given: Unpack[ReadoutOptions],
) -> int:
    """Read boxes, masks, segments, depth, normals or bench submissions out of frozen SCENES.

    An image of the track is read from SCENES/<file_name without extension>/scene.blend. Without
    --track every scene folder is an image. SCENES may be one .blend or .glb file. Several --task
    write RUNS/<task> for each, byte for byte what one alone writes. Without SCENES the shipped
    examples are read. Re-run the same command to resume. Exit code 1 when a scene could not be
    read.

    \b
    Examples:
      legoworld readout --task coco
      legoworld readout scenes --task coco --track track.json -o runs/coco --workers 8
      legoworld readout scenes --task coco --task lvis --task eth3d --track tracks -o runs
      legoworld readout submissions --task bench --track bench/public/track.json -o runs/mine
    """
    if not isinstance(scenes, str):
        given["started"] = _started_ahead(given)
    from legoworld.api.readout import Run, default_output, readout
    from legoworld.shipped.examples import shipped_examples

    only = task[0] if len(task) == 1 else None
    if scenes is None:
        shipped = {name: shipped_examples(find_dataset(name)) for name in task}
        scenes = shipped[task[0]][0]
        given["track"] = given.get("track") or {name: own for name, (_, own) in shipped.items()}
        output = output or Path("legoworld-runs") / (f"examples-{only}" if only else "examples")
        named = f"the {only} examples" if only else "the examples"
        out.notice(f"no SCENES given: reading {named} that ship with legoworld")
    output = output or default_output(scenes, only)
    with shown_progress("scene" if only else "answer", quiet=out.quiet) as listener:
        given["listener"] = replace(listener, trace=out.trace)
        found = readout(scenes, output, task=only or list(task), **given)
    if out.as_json:
        print_json(found.to_dict())
    runs = {found.summary.task: found} if isinstance(found, Run) else found
    if not out.as_json:
        show_runs(runs, quiet=out.quiet, verbose=out.verbose)
    complete = all(run.complete for run in runs.values())
    return exit_codes.DONE if complete else exit_codes.INCOMPLETE


def _started_ahead(options: ReadoutOptions) -> BlenderProcess | None:
    """A Blender process that imports bpy while this process imports its own modules.

    It ends with this process. None where Blender may not be needed, such as with a snapshot cache.
    """
    match options:
        case {
            "cache": False,
            "source": "blend",
            "engine": "local",
            "time_limit_s": time_limit_s,
            "memory_limit_gib": memory_limit_gib,
        }:
            from legoworld.scene.blender_process import BlenderProcess, Limits
        case _:
            return None
    limits = Limits(time_s=time_limit_s, memory_bytes=int(memory_limit_gib * 2**30))
    process = BlenderProcess(limits)
    click.get_current_context().call_on_close(process.close)
    process.start()
    return process
