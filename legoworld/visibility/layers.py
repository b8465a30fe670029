"""Every instance as if it were alone: amodal masks, and who hides whom.

Drawn in one pass (layers.hpp). The result is sparse: one entry per instance and pixel that the
instance covers, so memory grows with the sum of the amodal areas, never with instances x pixels.
While it is made, an entry takes 12 bytes and a pixel 8, and the triangles of one round at most
some 100 MB (2 million triangles, or those of one instance): 10,000 instances whose amodal areas
add up to four pictures of 1920 x 1080 take about 120 MB and a round. `max_entries` bounds it.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.visibility.kernel import level, prepare, raise_for
from legoworld.visibility.library import Allocate, LayersStruct, library
from legoworld.visibility.projection import Projection
from legoworld.visibility.surfaces import HOLDOUT, Surfaces

#: Entries a call makes at most unless it is told otherwise: four layers at 8192 x 8192, 3.2 GB.
MAX_ENTRIES: Final = 2**28

_TOO_MANY: Final = 4

#: Entries whose pairs are counted together: bounds what the count takes in memory.
_BLOCK: Final = 2**22

#: Up to so many possible pairs, a table of all is faster than sorting those that occur.
_FEW_PAIRS: Final = 2**20


@dataclass(frozen=True, kw_only=True)
class AmodalLayers:
    """The nearest surface of each instance at each pixel centre, nearest instance first.

    Pixel p = row * W + column has the entries start[p]:start[p + 1]. start: (H * W + 1,) int64;
    instance: (E,) int32, ascending depth_z_m and, at equal depth, ascending id, as the kernel
    decides ties; depth_z_m: (E,) float32. Holdouts are one instance, HOLDOUT. Cut-out samples are
    not there.

    With A_i the pixels that have an entry of i, D_i its depths there, and I and D the buffers of
    `kernel.render`: the first entry of a pixel is I and D, bit for bit, or HOLDOUT where a holdout
    leaves I without a hit; A_i and D_i are the buffers of instance i drawn alone.
    """

    size_wh: tuple[int, int]
    start: NDArray[np.int64]
    instance: NDArray[np.int32]
    depth_z_m: NDArray[np.float32]

    def pixels(self) -> NDArray[np.int64]:
        """The pixel index of each entry: (E,)."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def mask(self, instance_id: int) -> NDArray[np.bool_]:
        """The amodal mask of one instance inside the picture: (H, W)."""
        entries = np.flatnonzero(self.instance == instance_id)
        mask = np.zeros(len(self.start) - 1, bool)
        mask[np.searchsorted(self.start, entries, side="right") - 1] = True
        return mask.reshape(self.size_wh[::-1])

    def masks(self, ids: Sequence[int]) -> NDArray[np.bool_]:
        """The amodal masks of distinct instances in one pass over all entries: (N, H, W)."""
        place = np.full(max([*ids, self.instance.max(initial=HOLDOUT)]) - HOLDOUT + 1, -1)
        place[np.array(ids, np.int64) - HOLDOUT] = np.arange(len(ids))
        at = place[self.instance - HOLDOUT]
        masks = np.zeros((len(ids), len(self.start) - 1), bool)
        masks[at[at >= 0], self.pixels()[at >= 0]] = True
        return masks.reshape(len(ids), *self.size_wh[::-1])

    def nearest(self, k: int) -> AmodalLayers:
        """The first k entries of each pixel."""
        counts = np.diff(self.start)
        kept = np.arange(len(self.instance)) - np.repeat(self.start[:-1], counts) < k
        start = np.concatenate([[0], np.cumsum(np.minimum(counts, k))]).astype(np.int64)
        return replace(
            self, start=start, instance=self.instance[kept], depth_z_m=self.depth_z_m[kept]
        )


@dataclass(frozen=True, kw_only=True)
class HiddenPixels:
    """Pixels of one instance with another one in front, counted by pair; ascending pairs.

    hidden, hiding: (K,) int32 instance ids, `hiding` also HOLDOUT; count: (K,) int64, at least 1.
    """

    hidden: NDArray[np.int32]
    hiding: NDArray[np.int32]
    count: NDArray[np.int64]

    def by_hidden(self) -> dict[int, dict[int, int]]:
        """Of each hidden instance those that hide it, with their pixels."""
        pixels: dict[int, dict[int, int]] = {}
        pairs = zip(self.hidden.tolist(), self.hiding.tolist(), self.count.tolist(), strict=True)
        for hidden, hiding, count in pairs:
            pixels.setdefault(hidden, {})[hiding] = count
        return pixels


def most_entries(surfaces: Surfaces, camera: Projection, size_wh: tuple[int, int]) -> int:
    """An upper bound of the entries of `amodal_layers`: pixels of the boxes of all placements.

    A placement that reaches nearer than the near plane has the whole picture.
    """
    low, high = np.zeros((2, len(surfaces.vertex_start) - 1, 3))
    used = np.diff(surfaces.vertex_start) > 0
    for function, to in ((np.minimum, low), (np.maximum, high)):
        to[used] = function.reduceat(surfaces.vertices, surfaces.vertex_start[:-1][used])
    kept = used[surfaces.placement_mesh]
    mesh, matrix = surfaces.placement_mesh[kept], surfaces.cam_from_mesh[kept]
    corners = np.array(list(product((False, True), repeat=3)))
    points = np.where(corners, high[mesh, None], low[mesh, None])
    seen = np.einsum("pij,pkj->pki", matrix[:, :, :3], points) + matrix[:, None, :, 3]
    front = seen[..., 2].min(axis=1) > camera.z_near
    scale = 1 if camera.orthographic else 1 / seen[front, :, 2:]
    uv = seen[front, :, :2] * [camera.fx, camera.fy] * scale + [camera.cx, camera.cy]
    ends = (np.clip(np.floor(uv.min(1)), 0, size_wh), np.clip(np.ceil(uv.max(1)), 0, size_wh))
    behind = int(np.count_nonzero(~front))
    return int((ends[1] - ends[0]).prod(axis=1).sum()) + behind * size_wh[0] * size_wh[1]


def amodal_layers(
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    *,
    depth_scale: float = 1.0,
    threads: int | None = None,
    max_entries: int = MAX_ENTRIES,
) -> AmodalLayers:
    """All instances of a picture, each as if it were alone.

    Raises as `kernel.render` does, and LegoWorldError when there are more than max_entries.
    """
    call = prepare(surfaces, projection, size_wh, depth_scale, threads)
    ids, ranks = np.unique(surfaces.placement_id, return_inverse=True)
    rank = np.ascontiguousarray(ranks, np.int32)
    call.surfaces.placement_id = rank.ctypes.data
    start = np.empty(size_wh[0] * size_wh[1] + 1, np.int64)
    made: list[NDArray[np.int32]] = []  # instance ids, and the bits of depths

    def allocate(entries: int, instance: Any, depth: Any) -> int:
        try:
            made.extend(np.empty((2, entries), np.int32))
        except MemoryError:
            return 0
        instance[0], depth[0] = made[0].ctypes.data, made[1].ctypes.data
        return 1

    struct = LayersStruct(
        instances=len(ids),
        ident=ids.ctypes.data,
        most=max_entries,
        allocate=Allocate(allocate),
        start=start.ctypes.data,
    )
    status = library().lw_layers(
        ctypes.byref(call.surfaces),
        ctypes.byref(call.view),
        ctypes.c_int32(call.threads),
        ctypes.c_int32(level()),
        ctypes.byref(struct),
    )
    if status == _TOO_MANY:
        raise LegoWorldError(
            "the amodal masks of a picture are too large together",
            found=f"more than {max_entries} pixels",
            next_step="use a smaller picture, or raise max_entries",
        )
    raise_for(status)
    return AmodalLayers(
        size_wh=size_wh, start=start, instance=made[0], depth_z_m=made[1].view(np.float32)
    )


def amodal_areas(layers: AmodalLayers, n_instances: int) -> NDArray[np.int64]:
    """|A_i|, the pixels of each amodal mask: (n_instances,)."""
    return np.bincount(layers.instance[layers.instance >= 0], minlength=n_instances)


def visible_areas(layers: AmodalLayers, n_instances: int) -> NDArray[np.int64]:
    """|V_i|, the visible pixels of each instance: (n_instances,)."""
    shown = layers.instance[layers.start[:-1][np.diff(layers.start) > 0]]
    return np.bincount(shown[shown >= 0], minlength=n_instances)


def occluders(layers: AmodalLayers) -> HiddenPixels:
    """n_ij: the pixels of A_i at which the picture shows j, i.e. j is the nearest of all.

    The sum over j is |A_i| - |V_i|.
    """
    counts = np.diff(layers.start)
    first = layers.instance[layers.start[:-1][counts > 0]]
    return _count_pairs(layers.instance, np.repeat(first, counts[counts > 0]))


def direct_occluders(layers: AmodalLayers) -> HiddenPixels:
    """The pixels of A_i at which j is the nearest layer in front of i.

    At equal depth, the lower id is in front. The sum over j is |A_i| - |V_i| here too.
    """
    first = layers.start[:-1][np.diff(layers.start) > 0]
    in_front = np.empty_like(layers.instance)
    in_front[1:] = layers.instance[:-1]
    in_front[first] = layers.instance[first]
    return _count_pairs(layers.instance, in_front)


def _count_pairs(hidden: NDArray[np.int32], hiding: NDArray[np.int32]) -> HiddenPixels:
    """Pairs of ids, counted; an instance with itself, the nearest of a pixel, is left out."""
    base = int(hidden.max(initial=HOLDOUT)) - HOLDOUT + 1
    pairs, count = np.empty(0, np.int64), np.empty(0, np.int64)
    for first in range(0, len(hidden), _BLOCK):
        block = slice(first, first + _BLOCK)
        pair = (hidden[block].astype(np.int64) - HOLDOUT) * base + hiding[block] - HOLDOUT
        if base * base <= _FEW_PAIRS:
            every = np.bincount(pair, minlength=base * base)
            new = np.flatnonzero(every)
            times = every[new]
        else:
            new, times = np.unique(pair, return_counts=True)
        pairs, place = np.unique(np.concatenate([pairs, new]), return_inverse=True)
        count = np.bincount(place, np.concatenate([count, times])).astype(np.int64)
    behind, front = pairs // base + HOLDOUT, pairs % base + HOLDOUT
    kept = (behind != front) & (behind >= 0)  # a holdout is never in the picture
    return HiddenPixels(
        hidden=behind[kept].astype(np.int32),
        hiding=front[kept].astype(np.int32),
        count=count[kept],
    )
