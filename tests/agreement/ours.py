"""Our own picture of a scene folder, one instance per occurrence of an object."""

from __future__ import annotations

import numpy as np
from agreement.comparison import ObjectPicture

from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import checked_artefacts
from legoworld.scene.instances import group
from legoworld.scene.labels import Labels
from legoworld.scene.read_scene import read_scene
from legoworld.scene.snapshot import Snapshot
from legoworld.visibility.view import view


def snapshot_of(
    folder: SceneFolder,
    blender: BlenderProcess,
    cache: SnapshotCache | None = None,
    *,
    corner_normals: bool = False,
) -> Snapshot:
    """The scene folder's snapshot, by the way every command takes."""
    files = checked_artefacts(folder, require_frozen=False)
    scene = read_scene(
        folder,
        source="blend",
        blender=blender,
        cache=cache,
        files=files,
        corner_normals=corner_normals,
    )
    return scene.snapshot


def picture_of(snapshot: Snapshot, size_wh: tuple[int, int]) -> ObjectPicture:
    """What the snapshot's camera sees, labels ignored; its normals where its corners have some."""
    grouping = group(snapshot, Labels(objects={}, collections={}, warnings=()))
    seen = view(snapshot, grouping, size_wh)
    instance_object = np.zeros(len(grouping.instances), np.int32)
    instance_object[grouping.surface_instance] = snapshot.occurrence_object[
        snapshot.surface_occurrence
    ]
    objects = [snapshot.objects[i] for i in instance_object.tolist()]
    normals = None
    if snapshot.corner_normal is not None:
        # A parent's scale can leave the camera's axes askew: normals go by the inverse transpose.
        cam_from_world = np.linalg.inv(np.array(snapshot.camera.world_from_camera)[:, :3])
        normals = (seen.normals("shading").normal_cam @ cam_from_world).astype(np.float32)
    return ObjectPicture(
        instance=seen.buffers.instance,
        names=tuple(f"{o.name}|{o.library or ''}" for o in objects),
        depth_z_m=seen.buffers.depth_z_m,
        normal_world=normals,
    )
