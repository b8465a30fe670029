"""Facts about the objects in a walk over the render's dependency graph, each read once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from legoworld.scene.blender.placements import Generator, Identity, Matrix

if TYPE_CHECKING:
    import bpy
    import mathutils

_MESHED_APART: Final = ("CURVE", "FONT", "META", "SURFACE")
"""Types Blender draws through a mesh that is an entry of its own in the dependency graph."""

_NOT_A_SURFACE: Final = ("EMPTY", "CAMERA", "LIGHT", "LIGHT_PROBE", "SPEAKER", "ARMATURE",
                         "LATTICE", "VOLUME")  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ObjectFacts:
    """What a walk needs to know about one object.

    indirect and holdout: by its view layer collections (and, for holdout, its own setting).
    """

    identity: Identity
    camera_sees: bool
    indirect: bool
    holdout: bool


@dataclass(kw_only=True)
class ObjectTable:
    """Facts by object, and what about these objects cannot be read."""

    view_layer: bpy.types.ViewLayer
    warnings: set[str]
    generators: dict[Identity, Generator] = field(default_factory=dict)
    _facts: dict[int, ObjectFacts] = field(default_factory=dict)
    _members: dict[int, frozenset[Identity]] = field(default_factory=dict)

    def facts(self, evaluated: bpy.types.Object) -> ObjectFacts:
        """The facts of an object as the render evaluates it."""
        original = evaluated.original
        key = original.as_pointer()
        if key not in self._facts:
            self._facts[key] = ObjectFacts(
                identity=identity(original),
                camera_sees=evaluated.visible_camera,
                # These two answer for original data only: for evaluated data they say no.
                indirect=original.indirect_only_get(view_layer=self.view_layer),
                holdout=original.holdout_get(view_layer=self.view_layer),
            )
            self.generators[identity(original)] = self._generator(evaluated, original)
            self._note_unread(original)
        return self._facts[key]

    def note_type(self, shown: bpy.types.Object) -> None:
        """Warn about a rendered entry that is not a mesh."""
        if shown.type not in _NOT_A_SURFACE and shown.type not in _MESHED_APART:
            name = shown.original.name
            self.warnings.add(f"{shown.type.lower()} object {name!r} is not read: it has no mesh")

    def _generator(self, evaluated: bpy.types.Object, original: bpy.types.Object) -> Generator:
        nodes = any(m.type == "NODES" for m in original.modifiers)
        members: frozenset[Identity] = frozenset()
        collection = original.instance_collection
        if original.instance_type == "COLLECTION" and collection is not None:
            key = collection.as_pointer()
            if key not in self._members:
                self._members[key] = frozenset(identity(o) for o in collection.all_objects)
            members = self._members[key]
        return Generator(
            instance_type=original.instance_type,
            members=members,
            ancestors=frozenset(identity(o) for o in ancestors(original)),
            makes_own_mesh=nodes or original.type in _MESHED_APART,
            scatters=nodes or len(original.particle_systems) > 0,
            stands_at=_invertible(evaluated.matrix_world),
        )

    def _note_unread(self, original: bpy.types.Object) -> None:
        for modifier in original.modifiers:
            if modifier.type == "SUBSURF" and modifier.use_adaptive_subdivision:
                self.warnings.add(
                    f"object {original.name!r} is subdivided adaptively: "
                    "read at its fixed render level"
                )


def identity(block: bpy.types.ID) -> Identity:
    """A datablock's name and the path of the library it comes from ("" for none).

    Packed copies of a library's data keep its path: their own name in the file tells them apart.
    """
    library = block.library
    if library is None:
        return (block.name, "")
    # The archive of one library may be there several times.
    archive = f"{library.filepath} [{library.name}]"
    return (block.name, archive if library.is_archive else library.filepath)


def ancestors(block: bpy.types.ID) -> list[Any]:
    """An object's parent, that one's parent, and so on."""
    chain = []
    parent = block.parent
    while parent is not None and parent not in chain:
        chain.append(parent)
        parent = parent.parent
    return chain


def _invertible(matrix: mathutils.Matrix) -> Matrix | None:
    determinant = matrix.determinant()
    if determinant == 0.0 or determinant != determinant or abs(determinant) == float("inf"):
        return None
    return (*matrix[0], *matrix[1], *matrix[2])
