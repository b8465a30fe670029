"""The compiled library of evaluation behind ctypes: loading, calls and return codes.

It has no threads of its own: calls release the GIL, as NumPy's do, and callers divide the work.
"""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility.library import open_library

_NO_MEMORY: Final = 1


@functools.cache
def library() -> ctypes.CDLL:
    """The library, loaded once per process. KernelBuildError when it is missing or stale."""
    return open_library(Path(__file__).parent, "library of evaluation")


def call(function: str, *arguments: object) -> None:
    """Call a function, whose int32 answer says how it ended. MemoryError where it had none.

    An array is passed as its pointer, a structure by reference, an int as int64; numbers of other
    types are given as such, like `ctypes.c_int32(n)`.
    """
    # The attribute is looked up in the library once: an index would do so at each call.
    done = getattr(library(), function)(*map(_passed, arguments))
    if done == _NO_MEMORY:
        raise MemoryError("no memory for the evaluation's compiled library")
    assert not done, f"the evaluation's compiled library answers {done}"


def _passed(argument: object) -> object:
    if isinstance(argument, np.ndarray):
        return pointer(argument)
    if isinstance(argument, ctypes.Structure):
        return ctypes.byref(argument)
    return ctypes.c_int64(argument) if isinstance(argument, int) else argument


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    """Where the values of an array of any shape lie, one after the other."""
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def pointers(*names: str) -> list[tuple[str, type[ctypes.c_void_p]]]:
    """Fields of a structure that point to arrays."""
    return [(name, ctypes.c_void_p) for name in names]
