"""Names in a requirement to surfaces of a snapshot: objects with their children, collections."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from legoworld.pluralize import nearest_names
from legoworld.scene.snapshot import Snapshot
from legoworld.solids.meshes import surface_points_m, surfaces_solid


class Entities:
    """The surfaces of one snapshot by the names people give objects and collections."""

    def __init__(self, snapshot: Snapshot) -> None:
        self.snapshot = snapshot
        self._surfaces_by_name: dict[str, NDArray[np.bool_] | None] = {}

    def surfaces(self, name: str) -> NDArray[np.bool_] | None:
        """(S,) bool: the surfaces of an object or a collection; None for a name the scene lacks.

        Of an object: its own, all below it in the object tree and what these instance. Of a
        collection: of all objects in it and below it. An object wins over a collection of the same
        name.
        """
        if name not in self._surfaces_by_name:
            self._surfaces_by_name[name] = self._surfaces(name)
        return self._surfaces_by_name[name]

    def nearest(self, name: str) -> list[str]:
        """The names most like one that the scene does not have."""
        names = {o.name for o in self.snapshot.objects} | {
            c.name for c in self.snapshot.collections
        }
        return nearest_names(name, sorted(names))

    def points_m(self, name: str) -> NDArray[np.float64]:
        """(N, 3) float64: the world coordinates of an entity's vertices, metres."""
        surfaces = self.surfaces(name)
        chosen = [] if surfaces is None else np.flatnonzero(surfaces).tolist()
        parts = [self.surface_points_m(surface) for surface in chosen]
        return np.concatenate([np.empty((0, 3), np.float64), *parts])

    def surface_points_m(self, surface: int) -> NDArray[np.float64]:
        """(N, 3) float64: the world coordinates of one surface's vertices, metres."""
        return surface_points_m(self.snapshot, surface)

    def triangles_m(self, surfaces: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(T, 3, 3) float64: corners of the triangles of some surfaces in the world, metres."""
        return surfaces_solid(self.snapshot, np.flatnonzero(surfaces).tolist()).corners

    def _surfaces(self, name: str) -> NDArray[np.bool_] | None:
        shot = self.snapshot
        roots = {i for i, o in enumerate(shot.objects) if o.name == name}
        if not roots:
            folders = {i for i, c in enumerate(shot.collections) if c.name == name}
            if not folders:
                return None
            folders = self._collections_below(folders)
            roots = {i for i, o in enumerate(shot.objects) if folders & set(o.collections)}
        chosen = np.zeros(len(shot.objects), bool)
        chosen[[i for i in range(len(shot.objects)) if roots & set(self._lineage[i])]] = True
        occurrence = chosen[shot.occurrence_object]
        # What an occurrence of the entity generates belongs to it, however deep.
        while True:
            by = shot.occurrence_instancer
            grown = occurrence | ((by >= 0) & occurrence[by])
            if (grown == occurrence).all():
                return np.asarray(grown[shot.surface_occurrence])
            occurrence = grown

    @cached_property
    def _lineage(self) -> list[list[int]]:
        """For each object itself and its ancestors."""
        lines = []
        for index in range(len(self.snapshot.objects)):
            line = [index]
            parent = self.snapshot.objects[index].parent
            while parent >= 0 and parent not in line:
                line.append(parent)
                parent = self.snapshot.objects[parent].parent
            lines.append(line)
        return lines

    def _collections_below(self, folders: set[int]) -> set[int]:
        below = set(folders)
        while True:
            more = {
                i for i, c in enumerate(self.snapshot.collections) if below & set(c.parents)
            } | below
            if more == below:
                return below
            below = more
