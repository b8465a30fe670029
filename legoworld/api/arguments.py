"""Checks of the Python API's arguments: an unusable value is a UsageError that names it.

Whatever a caller passes is looked at here, by the argument's name; the modules behind trust it.
"""

from __future__ import annotations

import functools
import inspect
import numbers
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar, cast

import numpy as np

from legoworld.errors import UsageError
from legoworld.tracks.track import Track
from legoworld.workers.engines import ENGINES

P = ParamSpec("P")
R = TypeVar("R")
#: Says what was expected; None for a value that can be used.
_Check = Callable[[Any], str | None]
#: The longest side of a view, as the command line takes it.
_LONGEST_PX: Final = 8192
_LARGEST: Final = 2**53
_LONGEST_NAME: Final = 255
_LONGEST_PATH: Final = 4095


def check_arguments(function: Callable[P, R], *, but: Iterable[str] = ()) -> Callable[P, R]:
    """Have every argument that `CHECKS` knows, `but` some, looked at before the function begins."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        named = signature.bind(*args, **kwargs).arguments
        for name, value in {**named, **named.get("given", {})}.items():
            if name in CHECKS and name not in but:
                check_argument(name, value)
        return function(*args, **kwargs)

    return cast("Callable[P, R]", call)


def optional_path(path: str | Path | None) -> Path | None:
    """An argument as a path, where it is given."""
    return None if path is None else Path(path)


def check_argument(name: str, value: object) -> None:
    """Raise UsageError unless the value can be used as the argument of that name."""
    expected = CHECKS[name](value)
    if expected:
        raise UsageError(
            f"the argument {name} cannot be used",
            found=_format_value(value),
            expected=expected,
        )


def _format_value(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} of shape {value.shape}"
    text = repr(value)
    return text if len(text) <= 100 else f"{text[:80]}... ({len(text):,} characters)"


def _check_path(value: object) -> str | None:
    if not isinstance(value, str | Path) or not str(value):
        return "a path: text or pathlib.Path"
    if "\0" in str(value):
        return "a path without a NUL character"
    try:
        parts = os.fsencode(value).split(b"/")
    except UnicodeEncodeError:
        return "a path that the file system can hold: no lone surrogates"
    if max(map(len, parts)) > _LONGEST_NAME or sum(map(len, parts)) + len(parts) > _LONGEST_PATH:
        return f"names of at most {_LONGEST_NAME} bytes, paths of at most {_LONGEST_PATH}"
    return None


def _check_integer(least: int, most: int = _LARGEST) -> _Check:
    def check(value: object) -> str | None:
        fine = isinstance(value, numbers.Integral) and not isinstance(value, bool)
        if fine and least <= int(cast("int", value)) <= most:
            return None
        return f"an integer of {least} to {most}" if most < _LARGEST else f"an integer from {least}"

    return check


def _check_positive(value: object) -> str | None:
    real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    fine = real and 0 < value < _LARGEST  # type: ignore[operator]
    return None if fine else "a finite number above 0"


def _check_between(low: float, high: float) -> _Check:
    def check(value: object) -> str | None:
        real = isinstance(value, numbers.Real) and not isinstance(value, bool)
        fine = real and low < value < high  # type: ignore[operator]
        return None if fine else f"a number between {low} and {high}"

    return check


def _check_clip(value: object) -> str | None:
    expected = "(nearest, farthest), finite numbers above 0, in this order"
    wrong = _check_pair(_check_positive, expected)(value)
    return wrong or (None if value[0] < value[1] else expected)  # type: ignore[index]


def _check_pair(check: _Check, expected: str) -> _Check:
    def check_both(value: object) -> str | None:
        fine = isinstance(value, tuple | list) and len(value) == 2
        return None if fine and not any(map(check, cast("list[Any]", value))) else expected

    return check_both


def _check_each(check: _Check, expected: str) -> _Check:
    def every(value: object) -> str | None:
        if isinstance(value, str | bytes | dict) or not isinstance(value, Iterable):
            return expected
        return next((f"{expected}: {bad}" for bad in map(check, value) if bad), None)

    return every


def _one_of(*names: str) -> _Check:
    return lambda value: None if value in names else f"one of {', '.join(map(repr, names))}"


def _of_kind(kind: type, check: _Check) -> _Check:
    return lambda value: None if isinstance(value, kind) else check(value)


def _or_none(check: _Check) -> _Check:
    return lambda value: None if value is None else check(value)


def _check_text(value: object) -> str | None:
    return None if isinstance(value, str) else "text"


def _check_photo(value: object) -> str | None:
    if not isinstance(value, np.ndarray):
        return _check_path(value)
    fine = value.dtype == np.uint8 and value.ndim == 3 and value.shape[2] == 3
    return None if fine else "an (H, W, 3) array of uint8, or a path"


def _task(value: object) -> str | None:
    several = isinstance(value, list | tuple) and all(isinstance(one, str) for one in value)
    return None if isinstance(value, str) or several else "text, or a list of texts"


def _by_task(check: _Check, expected: str) -> _Check:
    """A value, or a mapping of values by the names of tasks."""

    def check_each(value: object) -> str | None:
        if not isinstance(value, Mapping):
            return check(value)
        named = bool(value) and all(isinstance(task, str) for task in value)
        return next(filter(None, map(check, value.values())), None) if named else expected

    return check_each


def _check_shard(value: object) -> str | None:
    expected = "(i, n), integers with 1 <= i <= n"
    wrong = _check_pair(_check_integer(1), expected)(value)
    return wrong or (None if value[0] <= value[1] else expected)  # type: ignore[index]


def _check_evaluation(value: object) -> str | None:
    one = hasattr(value, "summary") or isinstance(value, Mapping)
    return None if one and hasattr(value, "folder") else _check_path(value)


_SIZE: Final = f"(width, height), integers of 1 to {_LONGEST_PX}"
CHECKS: Final[dict[str, _Check]] = {
    **dict.fromkeys(("scenes", "output", "folder", "run"), _check_path),
    "truth": _by_task(_check_path, "ground truths by task"),
    "track": _or_none(_by_task(_of_kind(Track, _check_path), "tracks by task")),
    "cache": _of_kind(bool, _check_path),
    "photo": _or_none(_check_photo),
    "evaluations": _check_each(_check_evaluation, "evaluations or their folders"),
    "task": _or_none(_task),
    "source": _one_of("blend", "glb"),
    "engine": _one_of(*ENGINES),
    "evaluator": _or_none(_one_of("official", "fast")),
    "camera_model": _or_none(_one_of("none", "dataset")),
    **dict.fromkeys(("reference_sampling", "sky", "vocabulary"), _or_none(_check_text)),
    "variant": _or_none(_one_of("geometric", "shading")),
    "size_wh": _or_none(_check_pair(_check_integer(1, _LONGEST_PX), _SIZE)),
    "shard": _or_none(_check_shard),
    "image_ids": _check_each(_check_integer(0), "image ids"),
    "image_id": _check_integer(0),
    "instance_id": _check_integer(0),
    "n": _check_integer(1),
    "form": _one_of("torchvision", "hf"),
    "arrays": _one_of("numpy", "torch"),
    "radius": _check_positive,
    "ortho_scale": _or_none(_check_positive),
    "fov_deg": _or_none(_check_between(0, 180)),
    "elevation_deg": _check_between(-90, 90),
    "clip": _or_none(_check_clip),
    "fail_below": _check_each(_check_text, "METRIC=DELTA texts"),
    **dict.fromkeys(
        ("workers", "limit", "images_per_file", "max_side"), _or_none(_check_integer(1))
    ),
    "draws": _or_none(_check_integer(1)),
    "seed": _check_integer(0),
    **dict.fromkeys(("time_limit_s", "memory_limit_gib"), _check_positive),
}
