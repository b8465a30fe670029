"""A camera inside of something: one object is all it sees, close before everything else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.readouts.surface import VisibleSurface
from legoworld.scene.snapshot import Snapshot
from legoworld.visibility.view import surfaces_through

#: The share of the hits that one object has before it is asked what it hides. Not all of them: the
#: near clip plane cuts a hole into a wall that is nearer than it.
_FILLED: Final = 0.95
#: The share of its pixels that would show something else without it: else nothing is lost.
_HIDES: Final = 0.25
#: How much farther, at the median, that is. A room that is one mesh hides the ground outside of
#: it, at a few times the distance of its own walls, and is no mistake.
_FARTHER: Final = 4.0


@dataclass(frozen=True, kw_only=True)
class FilledView:
    """The object that fills a view. share: of the hits; depth_m: the median of its depth there.

    hidden: objects that would be seen without it; farther: the median ratio of their depth to its.
    """

    object: str
    share: float
    depth_m: float
    hidden: int
    farther: float


def filled_view(
    snapshot: Snapshot, seen: VisibleSurface, *, threads: int | None = None
) -> FilledView | None:
    """What fills a view and hides the rest of the scene; None for any other view.

    An object is one occurrence, so of many copies each is its own. The view is drawn again without
    it, where it fills the view at all. A scene that is one object hides nothing.
    """
    hit = seen.shown >= 0
    if not hit.any():
        return None
    of_pixel = snapshot.surface_occurrence[seen.shown[hit]]
    area = np.bincount(of_pixel)
    owner = int(area.argmax())
    share = int(area[owner]) / len(of_pixel)
    if share < _FILLED:
        return None
    others = np.flatnonzero(snapshot.surface_occurrence != owner)
    behind = surfaces_through(
        seen.projection, with_surfaces(snapshot, others), seen.raster_wh, threads=threads
    )
    owned = np.zeros_like(hit)
    owned[hit] = of_pixel == owner
    hides = owned & (behind.instance >= 0)
    n_hides = int(np.count_nonzero(hides))
    if not n_hides or n_hides < _HIDES * int(area[owner]):
        return None
    near, far = seen.depth_z_m[hides], behind.depth_z_m[hides]
    farther = float(np.median(far.astype(np.float64) / near))
    if farther < _FARTHER:
        return None
    hidden = snapshot.surface_occurrence[others][behind.instance[hides]]
    return FilledView(
        object=snapshot.objects[int(snapshot.occurrence_object[owner])].name,
        share=share,
        depth_m=float(np.median(near)),
        hidden=len(np.unique(hidden)),
        farther=farther,
    )


def with_surfaces(snapshot: Snapshot, surfaces: NDArray[np.int64]) -> Snapshot:
    """The snapshot with these (n,) surfaces alone, in their order."""
    return replace(
        snapshot,
        surface_occurrence=snapshot.surface_occurrence[surfaces],
        surface_mesh=snapshot.surface_mesh[surfaces],
        surface_holdout=snapshot.surface_holdout[surfaces],
        world_from_mesh=snapshot.world_from_mesh[surfaces],
    )
