"""The TOML file of a folder that says what its arrays are, where they cannot say it themselves."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from legoworld.errors import LegoWorldError, UsageError, cause
from legoworld.files import Json, utf8_text, write_text


def read_declared(
    path: Path,
    fits: Mapping[str, Callable[[Json], bool]],
    *,
    expected: str,
    error: type[LegoWorldError],
) -> dict[str, Any]:
    """The values of a folder's file by their keys; none without one. The error if it is invalid.

    fits: the keys that there are, and whether a value can be theirs.
    """
    if not path.is_file():
        return {}
    try:
        values = tomllib.loads(utf8_text(path.read_bytes()))
    except (OSError, ValueError, RecursionError) as broken:
        raise error(f"{path.name} cannot be read", found=cause(broken)) from broken
    wrong = [key for key in values if key not in fits]
    wrong += [key for key, value in values.items() if key in fits and not fits[key](value)]
    if wrong:
        raise error(
            f"{path.name} has an unknown key or value",
            found=f"{wrong[0]} = {values[wrong[0]]!r}",
            expected=expected,
        )
    return values


def is_text(value: Json) -> bool:
    """Whether a value is a text."""
    return isinstance(value, str)


def declare(path: Path, there: Mapping[str, Json], given: Mapping[str, str | None]) -> str | None:
    """Write what is given into a folder's file, unless there is one; None where it says it already.

    there: what it declares. UsageError where that is something else.
    """
    stated = {key: value for key, value in given.items() if value is not None}
    wanted = {**there, **stated}
    if wanted == there:
        return None
    if path.exists():
        raise UsageError(
            f"{path.name} declares {path.parent.name} differently",
            found=", ".join(f"{key} {there[key]!r}" for key in given),
            expected=", ".join(f"{key} {wanted[key]!r}" for key in given)
            + ", as on the command line",
            next_step=f"correct {path.name}, or omit {' and '.join(f'--{key}' for key in given)}",
        )
    text = "".join(f'{key} = "{value}"\n' for key, value in stated.items())
    write_text(path, text)
    return text
