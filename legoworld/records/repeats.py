"""Values that stand in a list more than once."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import TypeVar

T = TypeVar("T", bound=Hashable)


def find_repeated(values: Iterable[T]) -> list[T]:
    """Each value that occurs more than once, in the order of first occurrences; in linear time."""
    times: dict[T, int] = {}
    for value in values:
        times[value] = times.get(value, 0) + 1
    return [value for value, n in times.items() if n > 1]
