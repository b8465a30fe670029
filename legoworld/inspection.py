"""What is in one scene, for people who want to know why it reads out as it does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import LegoWorldError
from legoworld.files import atomic_path, readable_json, write_text
from legoworld.pictures import (
    depth_picture,
    instance_picture,
    overlay,
    read_photo,
    write_png,
)
from legoworld.readouts.exports import bbox_xywh_px
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import LABELS, SceneFolder, Source
from legoworld.scene.freeze import checked_artefacts
from legoworld.scene.instances import Grouping, group
from legoworld.scene.labels import read_labels_file, resolve_labels
from legoworld.scene.reading import ReadScene, read_scene
from legoworld.visibility.camera import aspect_differs
from legoworld.visibility.view import View, unseen_reasons, view
from legoworld.vocabulary import Vocabulary


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """One scene read out, with every instance described. entries: rows of instances.json."""

    scene: ReadScene
    view: View
    entries: tuple[dict[str, Any], ...]
    warnings: tuple[str, ...]
    outside_vocabulary: dict[str, int]
    not_rendered: tuple[tuple[str, str], ...]  # labelled owners without any surface: name, label


def inspect_scene(
    folder: SceneFolder,
    *,
    size_wh: tuple[int, int] | None,
    vocabulary: Vocabulary | None,
    override_property: str | None,
    source: Source,
    blender: BlenderProcess,
    cache: SnapshotCache | None,
) -> Inspection:
    """Read one scene at a size (its own when None); raises the scene's verdict."""
    files = checked_artefacts(folder, require_frozen=False)
    scene = read_scene(folder, source=source, blender=blender, cache=cache, files=files)
    labels = resolve_labels(
        scene.snapshot, read_labels_file(folder.file(LABELS)), vocabulary, override_property
    )
    grouping = group(scene.snapshot, labels)
    size = size_wh or scene.snapshot.render.size_wh
    seen = view(scene.snapshot, grouping, size)
    warnings = [*scene.snapshot.warnings, *grouping.warnings, *labels.warnings]
    if aspect_differs(scene.snapshot.render, size):
        w, h = scene.snapshot.render.size_wh
        warnings.append(
            f"the scene's own picture is {w}x{h}: another aspect than {size[0]}x{size[1]}"
        )
    return Inspection(
        scene=scene,
        view=seen,
        entries=instance_entries(scene, grouping, seen),
        warnings=tuple(warnings),
        outside_vocabulary=grouping.outside_vocabulary,
        not_rendered=grouping.unseen_owners,
    )


def instance_entries(
    scene: ReadScene, grouping: Grouping, seen: View
) -> tuple[dict[str, Any], ...]:
    """The rows of instances.json, by id."""
    reasons = unseen_reasons(scene.snapshot, grouping, seen)
    return tuple(
        {
            "id": instance.id,
            "name": instance.name,
            "objects": list(instance.objects),
            "category": instance.category.name if instance.category else None,
            "labelled": instance.category is not None,
            "area_px": int(seen.area_px[instance.id]),
            "bbox_xywh_px": bbox_xywh_px(seen, instance.id),
            "nested_in": grouping.nested.get(instance.id),
            "reason": reasons.get(instance.id),
        }
        for instance in grouping.instances
    )


def write_inspection(inspection: Inspection, output: Path, photo: Path | None) -> None:
    """Write buffers.npz, instances.json, overlay.png and depth.png into a folder."""
    buffers = inspection.view.buffers
    ground = instance_picture(buffers.instance) if photo is None else read_photo(photo)
    if ground.shape[:2] != buffers.instance.shape:
        raise LegoWorldError(
            "the photo has another size than the view",
            found=f"{ground.shape[1]}x{ground.shape[0]}",
            expected="x".join(map(str, inspection.view.size_wh)),
            next_step=f"pass --size {ground.shape[1]}x{ground.shape[0]}",
        )
    output.mkdir(parents=True, exist_ok=True)
    with atomic_path(output / "buffers.npz") as temporary, temporary.open("wb") as stream:
        np.savez(stream, instance=buffers.instance, depth_z_m=buffers.depth_z_m)
    document = {"schema_version": SCHEMA_VERSION, "instances": list(inspection.entries)}
    write_text(output / "instances.json", readable_json(document))
    write_png(output / "overlay.png", overlay(ground, buffers.instance, inspection.entries))
    write_png(output / "depth.png", depth_picture(buffers.depth_z_m))
