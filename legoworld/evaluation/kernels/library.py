"""The compiled library of evaluation behind ctypes: loading, calls and return codes.

It has no threads of its own: calls release the GIL, as NumPy's do, and callers divide the work.
"""

from __future__ import annotations

import ctypes
import functools
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from legoworld.visibility.library import open_library
from legoworld.workers.processors import usable_cores

_NO_MEMORY: Final = 1
_FUNCTIONS: Final = (
    "lw_box_ious",
    "lw_box_volumes",
    "lw_hits",
    "lw_lanes",
    "lw_match",
    "lw_measure_masks",
    "lw_nearest",
    "lw_ordered",
    "lw_overlap_masks",
    "lw_pair",
    "lw_random_orders",
    "lw_resample",
    "lw_voxels",
    "lw_within",
)
_MOST_THREADS: Final = 8


@functools.cache
def library() -> ctypes.CDLL:
    """The library, loaded once per process. KernelBuildError when it is missing or stale."""
    loaded = open_library(Path(__file__).parent, "library of evaluation")
    for name in _FUNCTIONS:
        getattr(loaded, name).restype = ctypes.c_int32
    return loaded


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    """Where the values of an array of any shape lie, one after the other."""
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def pointers(*names: str) -> list[tuple[str, type[ctypes.c_void_p]]]:
    """Fields of a structure that point to arrays."""
    return [(name, ctypes.c_void_p) for name in names]


def check(done: int) -> None:
    """MemoryError when a call had none; its other answers are mistakes of the caller."""
    if done == _NO_MEMORY:
        raise MemoryError("no memory for the evaluation's compiled library")
    assert not done, f"the evaluation's compiled library answers {done}"


def category_threads() -> ThreadPoolExecutor:
    """A pool with one thread per core. Its results are added in category order."""
    return ThreadPoolExecutor(min(_MOST_THREADS, usable_cores()))
