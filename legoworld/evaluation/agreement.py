"""What was made again against what is on record: the same but for rounding, or where it is not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from legoworld.evaluation.checks import Check
from legoworld.files import Json

#: Logarithms differ in the last bits between machines.
_RELATIVE: Final = 1e-9
_LISTS: Final = (tuple, list)


def agreement(what: str, found: Json, recorded: Json) -> Check:
    """A check that two JSON values are the same."""
    place = _first_difference(found, recorded, "")
    if place is None:
        return Check("ok", what, "the same")
    return Check("DIFFERS", what, place[:100])


def _first_difference(found: Json, recorded: Json, place: str) -> str | None:
    """Where two JSON values differ by more than rounding, with both; None where they do not."""
    if isinstance(found, Mapping) and isinstance(recorded, Mapping):
        if found.keys() != recorded.keys():
            return f"{place} keys {sorted(found.keys() ^ recorded.keys())}"
        pairs = [(found[k], recorded[k], f"{place} {k}") for k in sorted(found)]
    elif isinstance(found, _LISTS) and isinstance(recorded, _LISTS) and len(found) == len(recorded):
        pairs = [
            (a, b, f"{place} {i}") for i, (a, b) in enumerate(zip(found, recorded, strict=True))
        ]
    elif isinstance(found, float) and isinstance(recorded, float | int):
        same = math.isclose(found, recorded, rel_tol=_RELATIVE, abs_tol=1e-12)
        return None if same else f"{place} {found!r}, on record {recorded!r}".strip()
    else:
        return None if found == recorded else f"{place} {found!r}, on record {recorded!r}".strip()
    return next((d for d in (_first_difference(*pair) for pair in pairs) if d is not None), None)
