"""Inspection of one scene: its instances, and the reasons for its readout."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import LegoWorldError, NoCameraError, SceneChangedError
from legoworld.files import atomic_path, write_text
from legoworld.readouts.exports import bbox_xywh_px, select_exported
from legoworld.readouts.pictures import (
    depth_picture,
    instance_picture,
    overlay,
    read_photo,
    write_png,
)
from legoworld.records.base import readable
from legoworld.records.scene_folder import InstanceRow, InstancesFile
from legoworld.running.scene_views import SceneViews
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import LABELS, SceneFolder, Source
from legoworld.scene.freeze import FrozenFiles, checked_artefacts, hash_artefacts
from legoworld.scene.instances import Grouping, Instance, group
from legoworld.scene.labels import Labels, read_labels_file, resolve_labels
from legoworld.scene.read_scene import ReadScene, read_scene
from legoworld.tracks.vocabulary import Vocabulary
from legoworld.visibility.camera import aspect_differs
from legoworld.visibility.distorted import LensMap
from legoworld.visibility.posed_camera import Camera
from legoworld.visibility.view import View, unseen_reasons, view_through


@dataclass(frozen=True, kw_only=True)
class OpenScene:
    """A scene that was read, before labels are resolved.

    warnings: about files that changed since the scene was frozen. no_camera: why only poses can be
    seen from, None for a scene with a camera.
    """

    folder: SceneFolder
    scene: ReadScene
    warnings: tuple[str, ...]
    no_camera: NoCameraError | None = None


@dataclass(frozen=True, kw_only=True)
class LabelledScene:
    """A scene with its labels and instances under one vocabulary, None for labels as written."""

    open_scene: OpenScene
    vocabulary: Vocabulary | None
    labels: Labels
    grouping: Grouping


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """One view of a scene, with all instances described.

    scene: with the camera of the view.
    """

    scene: ReadScene
    labelled: LabelledScene
    view: View

    @property
    def grouping(self) -> Grouping:
        """The scene's instances."""
        return self.labelled.grouping

    @property
    def outside_vocabulary(self) -> dict[str, int]:
        """Labels that the vocabulary lacks, and how many owners carry each."""
        return self.grouping.outside_vocabulary

    @property
    def not_rendered(self) -> tuple[tuple[str, str], ...]:
        """Labelled owners without any surface: name, label."""
        return self.grouping.unseen_owners

    @cached_property
    def entries(self) -> tuple[InstanceRow, ...]:
        """The rows of instances.json, by id."""
        return instance_entries(self.scene, self.grouping, self.view)

    @cached_property
    def exported_rows(self) -> tuple[InstanceRow, ...]:
        """The rows of the instances with a category and a visible pixel, by id."""
        visible = select_exported(self.grouping.instances, self.view)
        return tuple(_entry(self.grouping, self.view, instance, None) for instance in visible)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Caveats about this view, as sentences."""
        snapshot, size = self.labelled.open_scene.scene.snapshot, self.view.size_wh
        warnings = [
            *self.labelled.open_scene.warnings,
            *self.scene.files.warnings,
            *snapshot.warnings,
            *self.grouping.warnings,
            *self.labelled.labels.warnings,
        ]
        w, h = snapshot.render.size_wh
        if self.scene.snapshot is not snapshot:
            if snapshot.for_camera:
                warnings.append(
                    f"hair and points are meshed as camera {snapshot.camera.name!r} sees them: "
                    "from elsewhere their outlines are approximate"
                )
        elif aspect_differs(snapshot.render, size):
            warnings.append(
                f"the scene's own picture is {w}x{h}: another aspect than {size[0]}x{size[1]}"
            )
        return tuple(warnings)

    @cached_property
    def nearest(self) -> dict[str, list[str]]:
        """The most similar names for each label outside the vocabulary."""
        vocabulary = self.labelled.vocabulary
        return {
            label: vocabulary.nearest(label) if vocabulary else []
            for label in self.outside_vocabulary
        }


def open_scene(
    folder: SceneFolder,
    *,
    source: Source,
    blender: BlenderProcess,
    cache: SnapshotCache | None,
    require_frozen: bool = False,
    allow_changed: bool = False,
    any_camera: bool = False,
    corner_normals: bool = False,
) -> OpenScene:
    """Read one scene; raises its error.

    allow_changed: accept a scene that changed since it was frozen, with a warning. any_camera:
    accept one without a camera, to be seen from poses. corner_normals: whether its snapshot has
    them.
    """
    files, changed = _files(folder, require_frozen=require_frozen, allow_changed=allow_changed)
    read = partial(
        read_scene,
        folder,
        source=source,
        blender=blender,
        cache=cache,
        files=files,
        corner_normals=corner_normals,
    )
    try:
        return OpenScene(folder=folder, scene=read(), warnings=tuple(changed))
    except NoCameraError as error:
        if not any_camera:
            raise
        scene = read(any_camera=True)
        return OpenScene(folder=folder, scene=scene, warnings=tuple(changed), no_camera=error)


def label(
    open_scene: OpenScene, vocabulary: Vocabulary | None, override_property: str | None
) -> LabelledScene:
    """The scene's instances under a vocabulary. Raises LabelsInvalidError."""
    folder = open_scene.folder
    outside = () if folder.lone else read_labels_file(folder.file(LABELS))
    labels = resolve_labels(open_scene.scene.snapshot, outside, vocabulary, override_property)
    grouping = group(open_scene.scene.snapshot, labels)
    return LabelledScene(
        open_scene=open_scene, vocabulary=vocabulary, labels=labels, grouping=grouping
    )


def look(
    labelled: LabelledScene,
    *,
    size_wh: tuple[int, int] | None,
    threads: int | None = None,
    views: SceneViews | None = None,
) -> Inspection:
    """A scene's view at a size, None for its own.

    views: what was drawn of the scene for other vocabularies.
    """
    scene = labelled.open_scene.scene
    size = size_wh or scene.snapshot.render.size_wh
    drawn = SceneViews() if views is None else views
    seen = drawn.view(scene.snapshot, labelled.grouping, size, exact=True, threads=threads)
    return Inspection(scene=scene, labelled=labelled, view=seen)


def look_through(
    labelled: LabelledScene,
    camera: Camera,
    *,
    threads: int | None = None,
    lens: LensMap | None = None,
) -> Inspection:
    """A scene's view through any camera. lens: the map of the camera's lens, if it has one."""
    scene = labelled.open_scene.scene
    pinhole = camera.projection(scene.snapshot)
    snapshot = replace(scene.snapshot, camera=camera.placed_in(scene.snapshot))
    seen = view_through(
        pinhole, snapshot, labelled.grouping, camera.size_wh, threads=threads, lens=lens
    )
    return Inspection(scene=replace(scene, snapshot=snapshot), labelled=labelled, view=seen)


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
        now = hash_artefacts(folder)
        files = FrozenFiles(artefacts=now, dependencies={}, frozen="at_readout")
        return files, [f"{error.what}: readout refuses the scene until it is frozen again"]


def instance_entries(scene: ReadScene, grouping: Grouping, view: View) -> tuple[InstanceRow, ...]:
    """The rows of instances.json, by id."""
    reasons = unseen_reasons(scene.snapshot, grouping, view)
    return tuple(_entry(grouping, view, i, reasons.get(i.id)) for i in grouping.instances)


def _entry(grouping: Grouping, view: View, instance: Instance, reason: str | None) -> InstanceRow:
    category = instance.category
    return InstanceRow(
        id=instance.id,
        name=instance.name,
        objects=instance.objects,
        category=category.name if category else None,
        category_id=category.id if category and category.id >= 0 else None,
        labelled=category is not None,
        area_px=int(view.area_px[instance.id]),
        bbox_xywh_px=bbox_xywh_px(view, instance.id),
        nested_in=grouping.enclosing_instance.get(instance.id),
        reason=reason,
    )


def write_inspection(inspection: Inspection, output: Path, photo: Path | None) -> None:
    """Write buffers.npz, instances.json, overlay.png, depth.png. LegoWorldError for the photo."""
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
