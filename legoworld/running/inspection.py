"""Inspection of one scene: its instances, and the reasons for its readout."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import LegoWorldError, SceneChangedError
from legoworld.files import atomic_path, write_text
from legoworld.readouts.exports import bbox_xywh_px
from legoworld.readouts.pictures import (
    depth_picture,
    instance_picture,
    overlay,
    read_photo,
    write_png,
)
from legoworld.records.base import readable
from legoworld.records.instances import InstanceRow, InstancesFile
from legoworld.running.scene_views import SceneViews
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import LABELS, SceneFolder, Source
from legoworld.scene.freeze import FrozenFiles, checked_artefacts, hash_files
from legoworld.scene.instances import Grouping, group
from legoworld.scene.labels import read_labels_file, resolve_labels
from legoworld.scene.read_scene import ReadScene, read_scene
from legoworld.tracks.vocabulary import Vocabulary
from legoworld.visibility.camera import aspect_differs
from legoworld.visibility.view import View, unseen_reasons


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """One scene read out, with all instances described. entries: rows of instances.json.

    nearest: the most similar names for each label outside the vocabulary.
    """

    scene: ReadScene
    grouping: Grouping
    view: View
    entries: tuple[InstanceRow, ...]
    warnings: tuple[str, ...]
    outside_vocabulary: dict[str, int]
    nearest: dict[str, list[str]]
    not_rendered: tuple[tuple[str, str], ...]  # labelled owners without any surface: name, label


@dataclass(frozen=True, kw_only=True)
class OpenScene:
    """A scene that was read, before labels are resolved.

    warnings: about files that changed since the scene was frozen.
    """

    folder: SceneFolder
    scene: ReadScene
    warnings: tuple[str, ...]


def open_scene(
    folder: SceneFolder,
    *,
    source: Source,
    blender: BlenderProcess,
    cache: SnapshotCache | None,
    require_frozen: bool = False,
    allow_changed: bool = False,
    corner_normals: bool = False,
) -> OpenScene:
    """Read one scene; raises its error.

    allow_changed: accept a scene that changed since it was frozen, with a warning. corner_normals:
    whether its snapshot has them.
    """
    files, changed = _files(folder, require_frozen=require_frozen, allow_changed=allow_changed)
    scene = read_scene(
        folder,
        source=source,
        blender=blender,
        cache=cache,
        files=files,
        corner_normals=corner_normals,
    )
    return OpenScene(folder=folder, scene=scene, warnings=tuple(changed))


def look(
    opened: OpenScene,
    *,
    size_wh: tuple[int, int] | None,
    vocabulary: Vocabulary | None,
    override_property: str | None,
    threads: int | None = None,
    views: SceneViews | None = None,
) -> Inspection:
    """A scene's view at a size, None for its own. Raises LabelsInvalidError.

    views: what was drawn of the scene for other vocabularies.
    """
    scene = opened.scene
    labels = resolve_labels(
        scene.snapshot, read_labels_file(opened.folder.file(LABELS)), vocabulary, override_property
    )
    grouping = group(scene.snapshot, labels)
    size = size_wh or scene.snapshot.render.size_wh
    drawn = SceneViews() if views is None else views
    seen = drawn.view(scene.snapshot, grouping, size, exact=True, threads=threads)
    warnings = [
        *opened.warnings,
        *scene.files.warnings,
        *scene.snapshot.warnings,
        *grouping.warnings,
        *labels.warnings,
    ]
    if aspect_differs(scene.snapshot.render, size):
        w, h = scene.snapshot.render.size_wh
        warnings.append(
            f"the scene's own picture is {w}x{h}: another aspect than {size[0]}x{size[1]}"
        )
    return Inspection(
        scene=scene,
        grouping=grouping,
        view=seen,
        entries=instance_entries(scene, grouping, seen),
        warnings=tuple(warnings),
        outside_vocabulary=grouping.outside_vocabulary,
        nearest={
            label: vocabulary.nearest(label) if vocabulary else []
            for label in grouping.outside_vocabulary
        },
        not_rendered=grouping.unseen_owners,
    )


def _files(
    folder: SceneFolder, *, require_frozen: bool, allow_changed: bool
) -> tuple[FrozenFiles, list[str]]:
    """The scene's current files, and a warning if they changed since it was frozen."""
    try:
        return checked_artefacts(folder, require_frozen=require_frozen), []
    except SceneChangedError as error:
        if not allow_changed:
            raise SceneChangedError(
                error.what,
                found=error.found,
                expected=error.expected,
                next_step="`legoworld freeze` the scene again if the change is intended, otherwise "
                "restore the file, or pass --allow-changed to inspect it as it is",
            ) from error
        now = hash_files(folder.path, folder.artefacts())
        files = FrozenFiles(artefacts=now, dependencies={}, frozen="at_readout")
        return files, [f"{error.what}: readout refuses the scene until it is frozen again"]


def instance_entries(scene: ReadScene, grouping: Grouping, seen: View) -> tuple[InstanceRow, ...]:
    """The rows of instances.json, by id."""
    reasons = unseen_reasons(scene.snapshot, grouping, seen)
    return tuple(
        InstanceRow(
            id=instance.id,
            name=instance.name,
            objects=instance.objects,
            category=instance.category.name if instance.category else None,
            labelled=instance.category is not None,
            area_px=int(seen.area_px[instance.id]),
            bbox_xywh_px=bbox_xywh_px(seen, instance.id),
            nested_in=grouping.nested.get(instance.id),
            reason=reasons.get(instance.id),
        )
        for instance in grouping.instances
    )


def write_inspection(inspection: Inspection, output: Path, photo: Path | None) -> None:
    """Write buffers.npz, instances.json, overlay.png and depth.png into a folder."""
    buffers = inspection.view.buffers
    ground = instance_picture(buffers.instance) if photo is None else read_photo(photo)
    if ground.shape[:2] != buffers.instance.shape:
        raise LegoWorldError(
            "the photo and the view have different sizes",
            found=f"{ground.shape[1]}x{ground.shape[0]}",
            expected="x".join(map(str, inspection.view.size_wh)),
            next_step=f"pass --size {ground.shape[1]}x{ground.shape[0]}",
        )
    output.mkdir(parents=True, exist_ok=True)
    with atomic_path(output / "buffers.npz") as temporary, temporary.open("wb") as stream:
        np.savez(stream, instance=buffers.instance, depth_z_m=buffers.depth_z_m)
    document = InstancesFile(schema_version=SCHEMA_VERSION, instances=inspection.entries)
    write_text(output / "instances.json", readable(document))
    write_png(output / "overlay.png", overlay(ground, buffers.instance, inspection.entries))
    write_png(output / "depth.png", depth_picture(buffers.depth_z_m))
