"""The state of a scene as the plugin compares it: one entry per object, and what they share."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import Record

#: What can differ between two states of one entity.
ChangeKind = Literal[
    "added",
    "removed",
    "transform",
    "mesh",
    "material",
    "parent",
    "collection",
    "visibility",
    "modifier",
    "data",
    "property",
    "camera",
    "render",
    "world",
]


class EntityState(Record, frozen=True, kw_only=True):
    """One object datablock of the file, as saved.

    library: the path of the linked file, null for a local object. transform: matrix_basis and
    matrix_parent_inverse, 32 numbers row by row. mesh_sha256: of the object's own mesh
    (coordinates, faces, UV maps, attributes), null where it has none. placement_sha256: of where
    its surfaces stand in the world as rendered (parents, constraints and instancing included), null
    for an object without a surface. The other hashes are of all settings Blender saves there.
    """

    name: str
    library: str | None
    type: str
    parent: str | None
    collections: tuple[str, ...]
    transform: tuple[float, ...]
    data: str | None
    data_sha256: str
    mesh_sha256: str | None
    materials: tuple[str | None, ...]
    material_sha256: str
    modifiers_sha256: str
    visibility_sha256: str
    properties_sha256: str
    placement_sha256: str | None = None

    @property
    def key(self) -> str:
        """The name that declarations and reports use; a linked object's ends in its library."""
        return self.name if self.library is None else f"{self.name} [{self.library}]"


class SceneState(Record, frozen=True, kw_only=True):
    """Everything a transaction guards.

    objects: sorted by name and library. camera: name of the active camera, null without one.
    camera_sha256: of its lens and pose. render_sha256: output size, engine, colour management.
    world_sha256: of the scene's world. collections_sha256: the collection tree with its visibility.
    geometry_signature: hash of the canonical snapshot. scene_signature: hash of all of the above.
    """

    objects: tuple[EntityState, ...]
    camera: str | None
    camera_sha256: str
    render_sha256: str
    world_sha256: str
    collections_sha256: str
    geometry_signature: str
    scene_signature: str


class Change(Record, frozen=True, kw_only=True):
    """One difference between two states: whose, and of which kind.

    entity: an object's key, or "camera", "render", "world" or "collections" for the scene's own;
    "scene" where the states differ in nothing that has a name.
    """

    entity: str
    kind: ChangeKind
