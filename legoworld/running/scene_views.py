"""The views of one scene that several tasks share, each drawn once."""

from __future__ import annotations

import numpy as np

from legoworld.scene.instances import Grouping
from legoworld.scene.snapshot import Snapshot
from legoworld.visibility.normals import Variant
from legoworld.visibility.view import View, view


class SceneViews:
    """Views of one snapshot through its own camera. normals: what some task asks of them."""

    def __init__(self, normals: Variant | None = None) -> None:
        self._normals: Variant | None = normals
        self._drawn_views: list[tuple[Grouping, View]] = []

    def view(
        self,
        snapshot: Snapshot,
        grouping: Grouping,
        size_wh: tuple[int, int],
        *,
        exact: bool,
        threads: int | None,
    ) -> View:
        """The view of a size, drawn at its first call.

        exact: the instance buffer is of this grouping; otherwise any grouping serves, since depth
        does not depend on it. Vocabularies that give every surface the same instance share a view:
        ties are broken by the instance's number.
        """
        for other, drawn in self._drawn_views:
            if drawn.size_wh == size_wh and (not exact or _same_instances(other, grouping)):
                return drawn
        drawn = view(
            snapshot, grouping, size_wh, exact=exact, normals=self._normals, threads=threads
        )
        self._drawn_views.append((grouping, drawn))
        return drawn


def _same_instances(one: Grouping, other: Grouping) -> bool:
    return len(one.instances) == len(other.instances) and np.array_equal(
        one.surface_instance, other.surface_instance
    )
