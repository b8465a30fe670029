"""How well a scene fits the photo's regions, whatever its objects are called.

Requirements name objects; independent reconstructions of a photo have no names in common. Here each
region is given the object whose visible pixels it shares most, one object to one region.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from legoworld.plugin.evidence import Evidence
from legoworld.plugin.measure import surface_view
from legoworld.plugin.state import LiveScene
from legoworld.scene.snapshot import Snapshot


def region_fit(scene: LiveScene, evidence: Evidence) -> dict[str, float]:
    """IoU of each region with the object that is matched to it, 0 where none is left.

    The matching has the largest sum of IoUs. An object is seen with all below it in the object
    tree, so that its parts count for it. LegoWorldError of a scene that shows nothing.
    """
    snapshot, regions = scene.snapshot, evidence.file.regions
    seen = surface_view(scene, evidence.size_wh).instance
    above = _with_ancestors(snapshot)
    owner = snapshot.occurrence_object[snapshot.surface_occurrence]
    counted = np.append(owner, len(snapshot.objects))[seen]  # the last one is nobody's
    areas = _pixels_of(counted.ravel(), above)
    table = np.zeros((len(regions), len(snapshot.objects)))
    for row, region in enumerate(regions):
        mask = evidence.mask(region)
        shared = _pixels_of(counted[mask], above)
        table[row] = shared / np.maximum(areas + np.count_nonzero(mask) - shared, 1)
    rows, columns = linear_sum_assignment(table, maximize=True)
    fit = dict.fromkeys((region.name for region in regions), 0.0)
    return fit | {regions[r].name: float(table[r, c]) for r, c in zip(rows, columns, strict=True)}


def _with_ancestors(snapshot: Snapshot) -> NDArray[np.float64]:
    """(O, O): 1 where the row's object is the column's or above it in the object tree."""
    above = np.eye(len(snapshot.objects))
    for index, item in enumerate(snapshot.objects):
        parent = item.parent
        while parent >= 0 and not above[parent, index]:
            above[parent, index] = 1
            parent = snapshot.objects[parent].parent
    return above


def _pixels_of(owners: NDArray[np.int32], above: NDArray[np.float64]) -> NDArray[np.float64]:
    """(O,): pixels of each object with all below it."""
    return np.asarray(above @ np.bincount(owners, minlength=len(above) + 1)[:-1])
