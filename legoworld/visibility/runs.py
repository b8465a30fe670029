"""What is counted in a finished picture of instance ids: areas, extents and masks.

In C++ (runs.hpp): every pixel of every picture is read here.
"""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError, ShapeError
from legoworld.visibility.layers import AmodalLayers
from legoworld.visibility.library import library

#: Characters a mask is first given; where all take more, they are written again.
_ONE_MASK = 8


def instance_extents(
    instance: NDArray[np.int32], n_instances: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Visible area (N,) and half-open extents x0, y0, x1, y1 (N, 4) of an (H, W) id picture.

    Ids below 0 are nothing. Raises ShapeError for an id of n_instances or more.
    """
    ids = np.ascontiguousarray(instance, np.int32)
    area = np.empty(n_instances, np.int64)
    extents = np.empty((n_instances, 4), np.int64)
    status = library().lw_extents(
        ctypes.c_void_p(ids.ctypes.data),
        ctypes.c_int32(ids.shape[1]),
        ctypes.c_int32(ids.shape[0]),
        ctypes.c_int64(n_instances),
        ctypes.c_void_p(area.ctypes.data),
        ctypes.c_void_p(extents.ctypes.data),
    )
    if status:
        raise ShapeError(
            "the picture holds an instance that is not among its instances",
            found=str(int(ids.max())),
            expected=f"ids below {n_instances}",
        )
    return area, extents


class ColumnRuns:
    """The masks of a picture as COCO writes them: compressed runs down its columns.

    Computed once for the instances 0..n_instances - 1: a separate mask each would cost H x W per
    instance. instance: (H, W) ids; or the layers of a picture, whose masks may overlap.
    """

    def __init__(self, instance: NDArray[np.int32] | AmodalLayers, n_instances: int) -> None:
        layers = None if isinstance(instance, np.ndarray) else instance
        ids = np.ascontiguousarray(layers.instance if layers else instance, np.int32)
        width, height = layers.size_wh if layers else ids.shape[::-1]
        self.size_hw: tuple[int, int] = (height, width)
        self._ends = np.empty(n_instances, np.int64)
        space = ids.size // 8 + _ONE_MASK * n_instances
        while True:
            text = np.empty(space, np.uint8)
            needed = library().lw_masks(
                ctypes.c_void_p(layers.start.ctypes.data if layers else None),
                ctypes.c_void_p(ids.ctypes.data),
                ctypes.c_int32(width),
                ctypes.c_int32(height),
                ctypes.c_int64(n_instances),
                ctypes.c_void_p(text.ctypes.data),
                ctypes.c_int64(space),
                ctypes.c_void_p(self._ends.ctypes.data),
            )
            if needed < 0:
                raise LegoWorldError(
                    "the masks of a picture ran out of memory", next_step="use fewer workers"
                )
            if needed <= space:
                break
            space = needed
        self._text = text[:needed].tobytes()

    def counts(self, instance_id: int) -> str:
        """Compressed RLE counts of one instance, byte for byte as pycocotools encodes its mask."""
        begin = self._ends[instance_id - 1] if instance_id else 0
        return self._text[begin : self._ends[instance_id]].decode("ascii")
