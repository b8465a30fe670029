"""Random orders of tied detections: orders.cpp behind ctypes, with numpy's own distributions."""

from __future__ import annotations

import ctypes
import functools
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import InstallationError
from legoworld.evaluation.detection.problem import Ints
from legoworld.evaluation.kernels.library import check, library, pointer

Counts = NDArray[np.int32]

#: numpy's manual, "Extending": the functions of distributions.h, from the module that holds them.
_DISTRIBUTIONS: Final = (
    "random_standard_uniform_fill_f",
    "random_standard_exponential_fill",
    "random_multinomial",
)


class _RandomStruct(ctypes.Structure):
    """LwRandom of orders.cpp."""

    _fields_: ClassVar = [
        ("bits", ctypes.c_void_p),
        ("floats", ctypes.c_void_p),
        ("exponentials", ctypes.c_void_p),
        ("multinomial", ctypes.c_void_p),
    ]


class _RunsStruct(ctypes.Structure):
    """LwRuns of orders.cpp."""

    _fields_: ClassVar = [
        ("start", ctypes.c_void_p),
        ("plain_in", ctypes.c_void_p),
        ("plain_before", ctypes.c_void_p),
        ("runs", ctypes.c_int64),
    ]


def random_orders(
    start: Ints, plain_in: Ints, plain_before: Ints, n: int, random: np.random.Generator
) -> tuple[Counts, Counts]:
    """n random orders of S special detections, and the plain false positives above each.

    start: (R + 1,) where each run of equal scores begins among them, and S; plain_in,
    plain_before: (R,) plain false positives in the run, and before it. Both returned are (n, S).
    The generator must not be used concurrently.
    """
    order, plain = np.empty((2, n, int(start[-1])), np.int32)
    bits: Any = random.bit_generator
    drawn = _RandomStruct(bits.ctypes.bit_generator.value, *_distributions())
    columns = [np.ascontiguousarray(c, np.int64) for c in (start, plain_in, plain_before)]
    runs = _RunsStruct(*(pointer(c) for c in columns), len(plain_in))
    done = library().lw_random_orders(
        ctypes.byref(drawn), ctypes.byref(runs), ctypes.c_int64(n), pointer(order), pointer(plain)
    )
    check(done)
    return order, plain


@functools.cache
def _distributions() -> tuple[int | None, ...]:
    """Where numpy's functions are."""
    from numpy.random import _generator

    loaded = ctypes.CDLL(_generator.__file__)
    try:
        functions = [getattr(loaded, name) for name in _DISTRIBUTIONS]
    except AttributeError as error:
        raise InstallationError(
            "this numpy does not hand out its random distributions",
            found=f"numpy {np.__version__}: {error}",
            expected=", ".join(_DISTRIBUTIONS),
            next_step="install numpy from its own wheels",
        ) from error
    return tuple(ctypes.cast(function, ctypes.c_void_p).value for function in functions)
