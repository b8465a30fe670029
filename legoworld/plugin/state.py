"""The state of a saved copy of a scene: its snapshot, and what a transaction compares."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError, from_reason
from legoworld.records.base import canonical, to_record
from legoworld.records.plugin_state import EntityState, SceneState
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.snapshot import Snapshot, load

#: The geometry signature of a scene that shows nothing: it has no snapshot, and no readout.
NOTHING: Final = "0" * 64


@dataclass(frozen=True, kw_only=True)
class LiveScene:
    """A copy of the live scene, read: what it shows and the state it was in.

    reading: the error is that of a readout: no camera, no surface.
    render: (h, w, 3) RGB of a small render, None where none was asked for.
    """

    reading: Snapshot | LegoWorldError
    state: SceneState
    render: NDArray[np.uint8] | None = None

    @property
    def snapshot(self) -> Snapshot:
        """The snapshot. Raises the readout's error of a scene that shows nothing."""
        if isinstance(self.reading, LegoWorldError):
            raise self.reading
        return self.reading


def read_live(blend: Path, blender: BlenderProcess) -> LiveScene:
    """Read a saved copy of a live scene. Raises the verdicts of `read_scene`.

    The geometry signature is the snapshot's content hash: the one `readout` records for the same
    file once it is frozen. A scene without a camera or a surface, as an agent begins with, has a
    state all the same.
    """
    output = blender.workspace("legoworld-live-") / "live.snapshot"
    answer = blender.request(
        {"kind": "state", "blend": str(blend.resolve()), "output": str(output)}
    )
    states = to_record(tuple[EntityState, ...], answer["objects"])
    reading: Snapshot | LegoWorldError
    if answer["unseen"] is not None:
        reading, content = from_reason(answer["unseen"]), NOTHING
    else:
        reading, content = load(output, passing=True)
    return LiveScene(
        reading=reading,
        state=scene_state(reading, content, states, answer["camera"], answer["hashes"]),
    )


def scene_state(
    reading: Snapshot | LegoWorldError,
    content_sha256: str,
    states: tuple[EntityState, ...],
    camera: str | None,
    hashes: Mapping[str, str],
) -> SceneState:
    """A state with the placements of a snapshot, signed."""
    import msgspec

    placed = {} if isinstance(reading, LegoWorldError) else placement_sha256(reading)
    unsigned = SceneState(
        objects=tuple(
            msgspec.structs.replace(o, placement_sha256=placed.get((o.name, o.library)))
            for o in states
        ),
        camera=camera,
        camera_sha256=hashes["camera"],
        render_sha256=hashes["render"],
        world_sha256=hashes["world"],
        collections_sha256=hashes["collections"],
        geometry_signature=content_sha256,
        scene_signature="",
    )
    return msgspec.structs.replace(unsigned, scene_signature=compute_signature(unsigned))


def compute_signature(state: SceneState) -> str:
    """The scene signature of a state, whatever it says itself."""
    import msgspec

    unsigned = msgspec.structs.replace(state, scene_signature="")
    return hashlib.sha256(canonical(unsigned).encode()).hexdigest()


def placement_sha256(snapshot: Snapshot) -> dict[tuple[str, str | None], str]:
    """By object (name, library): a hash of its meshes and of where they stand in the world.

    An object that is instanced has all of its placements in it, in the snapshot's order.
    """
    owner = snapshot.occurrence_object[snapshot.surface_occurrence]
    meshes = [_mesh_digest(snapshot, m) for m in range(len(snapshot.vertex_start) - 1)]
    digests: dict[tuple[str, str | None], str] = {}
    for index in np.unique(owner).tolist():
        digest = hashlib.sha256()
        for surface in np.flatnonzero(owner == index).tolist():
            digest.update(meshes[snapshot.surface_mesh[surface]])
            digest.update(snapshot.world_from_mesh[surface].tobytes())
        named = snapshot.objects[index]
        digests[(named.name, named.library)] = digest.hexdigest()
    return digests


def _mesh_digest(snapshot: Snapshot, mesh: int) -> bytes:
    vertices = slice(*snapshot.vertex_start[mesh : mesh + 2].tolist())
    triangles = slice(*snapshot.triangle_start[mesh : mesh + 2].tolist())
    digest = hashlib.sha256(np.ascontiguousarray(snapshot.vertices[vertices]).data)
    digest.update(np.ascontiguousarray(snapshot.triangles[triangles]).data)
    return digest.digest()
