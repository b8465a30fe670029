"""`legoworld inspect`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output, outside_the_vocabulary, table
from legoworld.commands.param_types import EXISTING_SCENES, FILE, TaskChoice
from legoworld.pluralize import plural, word_for
from legoworld.remote import Place

if TYPE_CHECKING:
    from legoworld.api.scene_view import SceneView
    from legoworld.records.scene_folder import InstanceRow
    from legoworld.running.source_comparison import Pair, SourceComparison


@click.command("inspect")
@click.argument("scene", type=EXISTING_SCENES)
@option("--size", "Image size, such as 640x480.")
@option("--photo", "Photo to draw over; sets the size.")
@option(
    "--task",
    "Task whose vocabulary resolves the labels [default: every label counts].",
    TaskChoice(lambda task: task.family.labelled),
)
@option("--track", "Track whose vocabulary resolves the labels; sets the task if it records one.")
@option("--source")
@flag(
    "--compare-sources",
    "Report where scene.blend and scene.glb disagree; exit code 1 when a mask does.",
)
@flag("--allow-changed", "Inspect a scene even if its files changed since it was frozen.")
@option("--output", "Folder for buffers and pictures.", required=False)
@option(
    "--animation",
    "Also write a looping WebP: the photo, the render, and the surfaces from around.",
    FILE,
)
@options.cache
@options.limits
@options.printing
def command(
    scene: Place,
    size_wh: tuple[int, int] | None,
    photo: Path | None,
    task: str | None,
    track: Path | None,
    compare_sources: bool,
    output: Path | None,
    animation: Path | None,
    out: Output,
    **given: Any,
) -> int:
    """Show the instances of one SCENE, and why some are not visible.

    SCENE: any .blend or .glb, or a scene folder or its URL.

    -o writes buffers.npz (instance int32, depth_z_m float32), instances.json, overlay.png and
    depth.png; of a task of amodal masks also amodal.png, hidden parts hatched; of boxes in space
    boxes3d.png and plan.png, from above.

    --compare-sources reads scene.blend and scene.glb and matches their instances by name: the
    masks of an instance agree at an IoU of 0.999 or more. With -o each source gets its own folder.

    \b
    Examples:
      legoworld inspect kitchen.blend
      legoworld inspect scenes/coffee --photo coffee.png -o look --animation coffee.webp
      legoworld inspect scenes/coffee --compare-sources --track track.json
      legoworld inspect s3://bucket/scenes/coffee --size 1200x800 --task lvis --json
    """
    from legoworld.api.folders import read_from
    from legoworld.api.scenes import open_scene
    from legoworld.api.settings import load_protocol

    if compare_sources:
        options.refuse_given(
            ["allow_changed", "animation"],
            "cannot be combined with --compare-sources: freeze, or show one of them, first",
        )
        options.refuse_given(
            ["source"], "cannot be combined with --compare-sources: both files are read"
        )
    _refuse_a_folder_of_scenes(scene)
    if photo is not None and size_wh is None:
        from legoworld.readouts.pictures import read_photo

        height, width = read_photo(photo).shape[:2]
        size_wh = (width, height)
    reading = load_protocol(task, track)  # refused before a scene is opened for it

    def look(folder: Path, size: tuple[int, int] | None) -> SceneView:
        return open_scene(folder, **given).view_by(reading, size)

    with read_from(scene) as here:
        if compare_sources:
            if here.is_file():
                raise click.UsageError("--compare-sources compares the two files of a scene folder")
            blend = look(here, size_wh)
            given["source"] = "glb"
            glb = look(here, blend.size_wh)
            if output is not None:
                blend.save(output / "blend", photo)
                glb.save(output / "glb", photo)
            return _show_comparison(blend.compared_with(glb), out)
        opened = open_scene(here, **given)
        view = opened.view_by(reading, size_wh)
        if output is not None:
            view.save(output, photo)
        if animation is not None:
            opened.animate(animation, photo)
    out.show(view.to_dict, _lines(view, output, out))
    return exit_codes.DONE


def _refuse_a_folder_of_scenes(scene: Place) -> None:
    """UsageError for a folder whose scenes lie one level below."""
    from legoworld.scene.folder import BLEND, GLB

    if not isinstance(scene, Path) or any((scene / name).exists() for name in (BLEND, GLB)):
        return
    below = sorted({p.parent for name in (BLEND, GLB) for p in scene.glob(f"*/{name}")})
    if below:
        raise click.UsageError(
            f"{scene} contains {plural(len(below), 'scene folder', 'scene folders')} but is not "
            f"one itself: pass one of them, such as {below[0]}"
        )


def _lines(view: SceneView, output: Path | None, out: Output) -> Iterator[str]:
    entries = sorted(view.instances, key=lambda e: (not e.labelled, -e.area_px))
    shown = entries if out.verbose else entries[:40]
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
    yield table(("id", "instance", "objects", "category", "area px", "x y w h"), rows)
    if len(shown) < len(entries):
        yield f"... and {len(entries) - len(shown)} more (-v lists them)"
    camera, render = view.camera, view.render
    labelled = sum(e.labelled for e in entries)
    width, height = view.size_wh
    yield (
        f"\n{plural(len(entries), 'instance', 'instances')} ({labelled} labelled), "
        f"{plural(view.n_triangles, 'triangle', 'triangles')}; "
        f"camera {camera.name!r} {camera.type} {camera.lens_mm:g} mm; {width}x{height}; "
        f"1 unit = {render.unit_scale:g} m; frame {render.frame}"
    )
    of_task = view.task_table
    if of_task is not None and of_task.rows:
        told = of_task.rows if out.verbose else of_task.rows[:40]
        yield f"\n{of_task.title}"
        yield table([column.name for column in of_task.columns], told)
        if len(told) < len(of_task.rows):
            yield f"... and {len(of_task.rows) - len(told)} more (-v lists them)"
    for name, count in view.outside_vocabulary.items():
        yield outside_the_vocabulary(name, count, view.nearest[name])
    for name, label in view.not_rendered:
        yield f"{name!r}, labelled {label!r}, has no surface that renders"
    for warning in view.warnings:
        out.notice(f"warning: {warning}")
    if output is not None:
        yield f"-> {output}"


def _comparison_document(comparison: SourceComparison) -> dict[str, Any]:
    """The comparison as a JSON document."""
    from legoworld.records.base import as_json

    return {
        "size_wh": list(comparison.blend.view.size_wh),
        "instances": [asdict(pair) for pair in comparison.pairs],
        "disagreeing": comparison.n_disagreeing,
        "differing_px": comparison.differing_px,
        "unseen": comparison.unseen,
        "lost": as_json(comparison.lost),
        "gained": as_json(comparison.gained),
        "differences": list(comparison.differences),
        "warnings": {
            "blend": list(comparison.blend.warnings),
            "glb": list(comparison.glb.warnings),
        },
        "snapshot_sha256": {
            "blend": comparison.blend.scene.snapshot_sha256,
            "glb": comparison.glb.scene.snapshot_sha256,
        },
    }


def _show_comparison(comparison: SourceComparison, out: Output) -> int:
    """Print the shared instances, worst first, and other differences; return the exit code."""
    out.show(lambda: _comparison_document(comparison), _comparison_lines(comparison, out))
    return exit_codes.DONE if comparison.faithful else exit_codes.INCOMPLETE


def _comparison_lines(comparison: SourceComparison, out: Output) -> Iterator[str]:
    pairs = (
        comparison.pairs if out.verbose else comparison.pairs[: max(40, comparison.n_disagreeing)]
    )
    rows = [
        (pair.name, _category(pair), pair.blend_area_px, pair.glb_area_px, f"{pair.iou:.5f}")
        for pair in pairs
    ]
    yield table(("instance", "category", ".blend px", ".glb px", "IoU"), rows)
    if len(pairs) < len(comparison.pairs):
        yield f"... and {len(comparison.pairs) - len(pairs)} more that agree (-v lists them)"
    width, height = comparison.blend.view.size_wh
    disagree = word_for(comparison.n_disagreeing, "disagrees", "disagree")
    yield (
        f"\n{plural(len(comparison.pairs), 'instance', 'instances')} in both sources at "
        f"{width}x{height}: {comparison.n_disagreeing} {disagree}; "
        f"{comparison.unseen} more {word_for(comparison.unseen, 'is', 'are')} not seen in either; "
        f"{plural(comparison.differing_px, 'pixel differs', 'pixels differ')}"
    )
    yield from _one_sided("only in scene.blend", comparison.lost)
    yield from _one_sided("only in scene.glb", comparison.gained)
    for line in comparison.differences:
        yield f"differs: {line}"
    for source, inspection in (("scene.blend", comparison.blend), ("scene.glb", comparison.glb)):
        for warning in inspection.warnings:
            out.notice(f"warning: {source}: {warning}")


def _category(pair: Pair) -> str:
    blend, glb = pair.blend_category or "-", pair.glb_category or "-"
    return blend if blend == glb else f"{blend} | {glb}"


def _one_sided(where: str, entries: tuple[InstanceRow, ...]) -> Iterator[str]:
    visible = sorted((e for e in entries if e.area_px), key=lambda e: -e.area_px)
    for entry in visible[:20]:
        category = f", {entry.category}" if entry.category else ""
        yield f"{where}: {entry.name!r}{category}, {entry.area_px} px"
    rest = len(entries) - len(visible[:20])
    if rest:
        yield f"{where}: {rest} more, {len(entries) - len(visible)} of them not seen"
