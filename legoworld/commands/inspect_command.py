"""`legoworld inspect`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from legoworld import exit_codes
from legoworld.commands import options, sources
from legoworld.commands.remote import PlaceType
from legoworld.commands.sentences import outside_the_vocabulary
from legoworld.pluralize import counted
from legoworld.remote import Place

if TYPE_CHECKING:
    from legoworld.api.scenes import SceneView


@click.command("inspect", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("scene", type=PlaceType(exists=True))
@click.option("--size", "size_wh", type=options.SizeType(), help="Image size, such as 640x480.")
@click.option("--photo", type=options.EXISTING_FILE, help="Photo to draw over; sets the size.")
@click.option(
    "--task",
    type=options.TaskChoice(lambda task: task.family.labelled),
    help="Task whose vocabulary resolves the labels [default: every label counts].",
)
@click.option(
    "--track",
    type=options.EXISTING_FILE,
    help="Track whose vocabulary resolves the labels; sets the task if it records one.",
)
@options.source
@click.option(
    "--compare-sources",
    is_flag=True,
    help="Report where scene.blend and scene.glb disagree; exit code 1 when a mask does.",
)
@click.option(
    "--allow-changed",
    is_flag=True,
    help="Inspect a scene even if its files changed since it was frozen.",
)
@click.option("-o", "--output", type=options.FOLDER, help="Folder for buffers and pictures.")
@options.caching
@options.limits
@options.output_options
def command(
    scene: Place,
    size_wh: tuple[int, int] | None,
    photo: Path | None,
    task: str | None,
    track: Path | None,
    source: Literal["blend", "glb"],
    compare_sources: bool,
    allow_changed: bool,
    output: Path | None,
    cache: Path | None,
    no_cache: bool,
    time_limit: float,
    memory_limit: float,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Show the instances of one SCENE (a folder or its URL), and why some are not visible.

    -o writes buffers.npz (instance int32, depth_z_m float32), instances.json, overlay.png and
    depth.png.

    --compare-sources reads scene.blend and scene.glb and matches their instances by name: the
    masks of an instance agree at an IoU of 0.999 or more. With -o each source gets its own folder.

    \b
    Examples:
      legoworld inspect scenes/000000000139
      legoworld inspect scenes/coffee --photo coffee.png -o look
      legoworld inspect scenes/coffee --compare-sources --track track.json
      legoworld inspect s3://bucket/scenes/coffee --size 1200x800 --task lvis --json
    """
    from legoworld.api.folders import read_from
    from legoworld.api.scenes import open_scene
    from legoworld.api.settings import protocol_of

    if compare_sources and allow_changed:
        raise click.UsageError(
            "--allow-changed cannot be combined with --compare-sources: freeze first"
        )
    if compare_sources:
        options.refuse_given(
            ["source"], "cannot be combined with --compare-sources: both files are read"
        )
    _refuse_a_folder_of_scenes(scene)
    if photo is not None and size_wh is None:
        from legoworld.readouts.pictures import read_photo

        height, width = read_photo(photo).shape[:2]
        size_wh = (width, height)
    reading = protocol_of(task, track)  # refused before a scene is opened for it

    def look(
        folder: Path, file: Literal["blend", "glb"], size: tuple[int, int] | None
    ) -> SceneView:
        opened = open_scene(
            folder,
            source=file,
            cache=options.cache_choice(cache, no_cache),
            allow_changed=allow_changed,
            time_limit_s=time_limit,
            memory_limit_gib=memory_limit,
        )
        return opened.view_by(reading, size)

    with read_from(scene) as here:
        if compare_sources:
            blend = look(here, "blend", size_wh)
            glb = look(here, "glb", blend.size_wh)
            if output is not None:
                blend.save(output / "blend", photo)
                glb.save(output / "glb", photo)
            differences = blend.compared_with(glb)
            return sources.show(differences, as_json=as_json, quiet=quiet, verbose=verbose)
        view = look(here, source, size_wh)
        if output is not None:
            view.save(output, photo)
    if as_json:
        options.print_json(view.to_dict())
    else:
        _print(view, output, quiet=quiet, verbose=verbose)
    return exit_codes.DONE


def _refuse_a_folder_of_scenes(scene: Place) -> None:
    """UsageError for a folder whose scenes lie one level below."""
    from legoworld.scene.folder import BLEND, GLB

    if not isinstance(scene, Path) or any((scene / name).exists() for name in (BLEND, GLB)):
        return
    below = sorted({p.parent for name in (BLEND, GLB) for p in scene.glob(f"*/{name}")})
    if below:
        raise click.UsageError(
            f"{scene} contains {counted(len(below), 'scene folder', 'scene folders')} but is not "
            f"one itself: pass one of them, such as {below[0]}"
        )


def _print(view: SceneView, output: Path | None, *, quiet: bool, verbose: bool) -> None:
    entries = sorted(view.instances, key=lambda e: (not e.labelled, -e.area_px))
    shown = entries if verbose else entries[:40]
    rows = [
        (
            e.id,
            e.name,
            len(e.objects),
            e.category or "-",
            e.area_px,
            " ".join(map(str, e.bbox_xywh_px)) if e.area_px else f"({e.reason})",
        )
        for e in shown
    ]
    header = ("id", "instance", "objects", "category", "area px", "x y w h")
    click.echo(options.table(header, rows))
    if len(shown) < len(entries):
        click.echo(f"... and {len(entries) - len(shown)} more (-v lists them)")
    camera, render = view.camera, view.render
    labelled = sum(e.labelled for e in entries)
    width, height = view.size_wh
    click.echo(
        f"\n{counted(len(entries), 'instance', 'instances')} ({labelled} labelled), "
        f"{counted(view.n_triangles, 'triangle', 'triangles')}; "
        f"camera {camera.name!r} {camera.type} {camera.lens_mm:g} mm; {width}x{height}; "
        f"1 unit = {render.unit_scale:g} m; frame {render.frame}"
    )
    for name, count in view.outside_vocabulary.items():
        click.echo(outside_the_vocabulary(name, count, view.nearest[name]))
    for name, label in view.not_rendered:
        click.echo(f"{name!r}, labelled {label!r}, has no surface that renders")
    if not quiet:
        for warning in view.warnings:
            click.echo(f"warning: {warning}", err=True)
    if output is not None:
        click.echo(f"-> {output}")
