"""What differs between two states of a scene, entity by entity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from legoworld.records.plugin_state import Change, ChangeKind, EntityState, SceneState

#: The fields of an object that make a change of each kind, in the order they are reported.
_OF_OBJECTS: Final[tuple[tuple[ChangeKind, tuple[str, ...]], ...]] = (
    ("transform", ("transform",)),
    ("mesh", ("mesh_sha256",)),
    ("material", ("materials", "material_sha256")),
    ("parent", ("parent",)),
    ("collection", ("collections",)),
    ("visibility", ("visibility_sha256",)),
    ("modifier", ("modifiers_sha256",)),
    ("data", ("type", "data", "data_sha256")),
    ("property", ("properties_sha256",)),
)


def changes(before: SceneState, after: SceneState) -> tuple[Change, ...]:
    """Every difference, objects by name first, then camera, render, world and collections.

    An object whose own settings are the same and whose surfaces stand elsewhere (its parent moved,
    or what it is constrained to) has changed its transform: a viewer sees it move. A renamed object
    is one removed and one added: Blender keeps no identity besides the name.
    """
    differences = tuple(_changes(before, after))
    if not differences and before.scene_signature != after.scene_signature:
        # Of no object: an alpha texture on disk, say, that cuts other holes into what is seen.
        return (Change(entity="scene", kind="data"),)
    return differences


def _changes(before: SceneState, after: SceneState) -> Iterator[Change]:
    old, new = ({o.key: o for o in state.objects} for state in (before, after))
    for key in sorted(old.keys() | new.keys()):
        if key not in new:
            yield Change(entity=key, kind="removed")
        elif key not in old:
            yield Change(entity=key, kind="added")
        else:
            yield from (Change(entity=key, kind=kind) for kind in _kinds(old[key], new[key]))
    if (before.camera, before.camera_sha256) != (after.camera, after.camera_sha256):
        yield Change(entity="camera", kind="camera")
    if before.render_sha256 != after.render_sha256:
        yield Change(entity="render", kind="render")
    if before.world_sha256 != after.world_sha256:
        yield Change(entity="world", kind="world")
    if before.collections_sha256 != after.collections_sha256:
        yield Change(entity="collections", kind="collection")


def _kinds(before: EntityState, after: EntityState) -> list[ChangeKind]:
    kinds: list[ChangeKind] = [
        kind
        for kind, fields in _OF_OBJECTS
        if any(getattr(before, field) != getattr(after, field) for field in fields)
    ]
    places = (before.placement_sha256, after.placement_sha256)
    moved = None not in places and places[0] != places[1]
    # A changed mesh or modifier also changes placements: that does not count as motion.
    if moved and "transform" not in kinds and not {"mesh", "modifier", "data"} & set(kinds):
        kinds.insert(0, "transform")
    return kinds
