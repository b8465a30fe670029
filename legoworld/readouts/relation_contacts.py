"""What touches, enters and holds what: pairs measured in the world by `legoworld.solids`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.instances import Instance
from legoworld.solids.hulls import HULL_SLACK_M, share_inside
from legoworld.solids.penetration import penetration_m
from legoworld.solids.solid import Solid
from legoworld.solids.support import rest_on

Floats = NDArray[np.float64]

#: Surfaces that are farther apart than this do not rest on each other.
TOUCH_M: Final = 0.01
#: The share of a thing in another's convex hull from which it may be inside of it.
INSIDE: Final = 0.95
#: Points of a thing of which it is asked whether another's volume holds them.
_MOST_POINTS: Final = 64
#: Boxes that overlap by less reach into each other by less: facts are rounded to a millionth.
FLUSH_M: Final = 5e-7


@dataclass(frozen=True, kw_only=True)
class ObjectArrays:
    """Objects as arrays: (n, 3) extents in the camera's frame and in the world, metres."""

    instances: Sequence[Instance]
    solids: Sequence[Solid]
    fronts: Floats
    cam_low: Floats
    cam_high: Floats
    low: Floats
    high: Floats

    @property
    def middle(self) -> Floats:
        """The middles of the world boxes."""
        return (self.low + self.high) / 2


@dataclass(frozen=True, kw_only=True)
class Contacts:
    """(n, n) arrays, NaN where unknown: surface and depth above the diagonal; of a on and in b."""

    surface: Floats
    depth: Floats
    rest_gap: Floats
    inside: Floats
    within: Floats


def contacts(arrays: ObjectArrays, apart: Floats, near: Floats) -> Contacts:
    """Of all pairs that are near by their boxes. apart, near: (n, n) metres."""
    n = len(arrays.solids)
    surface, depth, rest, inside, within = np.full((5, n, n), np.nan)
    inside[:] = 0
    overlap = np.minimum(arrays.high[:, None], arrays.high[None]) - np.maximum(
        arrays.low[:, None], arrays.low[None]
    )
    flush = overlap.min(axis=2) < FLUSH_M
    for a, b in np.argwhere(np.triu(apart <= near, 1)).tolist():
        one, two = arrays.solids[a], arrays.solids[b]
        surface[a, b] = gap = one.distance_m(two)
        if gap <= TOUCH_M:
            rest[a, b], rest[b, a] = _rest_gap(arrays, a, b), _rest_gap(arrays, b, a)
        if gap == 0:
            depth[a, b] = 0.0 if flush[a, b] else penetration_m(one.corners, two.corners)
        if apart[a, b] == 0:
            for i, j in ((a, b), (b, a)):
                inner, outer = arrays.solids[i], arrays.solids[j]
                inside[i, j] = _inside(inner, outer)
                if inside[i, j] >= INSIDE and outer.closed:
                    few = inner.points[:: len(inner.points) // _MOST_POINTS + 1]
                    within[i, j] = outer.share_within(few)
    return Contacts(surface=surface, depth=depth, rest_gap=rest, inside=inside, within=within)


def _rest_gap(arrays: ObjectArrays, a: int, b: int) -> float:
    """The gap of a above b where a rests there in balance; NaN elsewhere."""
    if arrays.high[a, 2] <= arrays.low[b, 2] + TOUCH_M:
        return math.nan
    rest = rest_on(arrays.solids[a].corners, arrays.solids[b].corners)
    return rest.gap_m if rest is not None and rest.balanced else math.nan


def _inside(inner: Solid, outer: Solid) -> float:
    """The share of one in the other's hull; up to a half, of the other's box, which is no less."""
    low, high = outer.points.min(axis=0), outer.points.max(axis=0)
    slack = (inner.points >= low - HULL_SLACK_M) & (inner.points <= high + HULL_SLACK_M)
    share = float(slack.all(axis=1).mean())
    if share <= 0.5:
        return share
    return math.nan if outer.planes is None else share_inside(inner.points, outer.planes)
