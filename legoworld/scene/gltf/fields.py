"""Typed access to untrusted JSON: values are checked when read; errors name the place."""

from __future__ import annotations

import math
import reprlib
from dataclasses import dataclass
from typing import Any, Final

from legoworld.errors import one_line
from legoworld.files import Json
from legoworld.scene.gltf.verdicts import UnreadableGltfError, unreadable

_LARGEST: Final = 2**53  # integers JSON readers agree on


@dataclass(frozen=True)
class Fields:
    """One JSON object and its place in the document, such as `accessors[3]`.

    Every getter raises UnreadableGltfError when the value has another type or range.
    """

    values: dict[str, Any]
    place: str = ""

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def at(self, name: str) -> str:
        """The place of one of this object's values."""
        return f"{self.place}.{name}" if self.place else name

    def wrong(self, name: str, expected: str) -> UnreadableGltfError:
        """The verdict for a value, as an exception to raise."""
        value = _format_value(self.values[name]) if name in self.values else "nothing"
        return unreadable(f"{self.at(name)} is {one_line(value, 80)}", expected)

    def integer(self, name: str, default: int | None = None) -> int:
        """An integer in [0, 2^53]; `default` if absent, None: required."""
        value = self.values.get(name, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if type(value) is not int or not 0 <= value <= _LARGEST:
            raise self.wrong(name, "an integer from 0")
        return value

    def index(self, name: str, length: int) -> int:
        """An index into a list of `length` entries; -1 where it is absent."""
        if name not in self.values:
            return -1
        value = self.integer(name)
        if value >= length:
            raise self.wrong(name, f"an index below {length}")
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number; `default` if absent, None: required."""
        value: Any = self.values.get(name, default)
        if type(value) not in (int, float) or not _finite(value):
            raise self.wrong(name, "a finite number")
        return float(value)

    def numbers(self, name: str, count: int | None = None) -> tuple[float, ...]:
        """A list of finite numbers; empty where it is absent."""
        value = self.values.get(name, ())
        if name in self.values:
            right = isinstance(value, list) and (count is None or len(value) == count)
            if not right or not all(type(v) in (int, float) and _finite(v) for v in value):
                raise self.wrong(name, f"{count or 'a list of'} finite numbers")
        return tuple(map(float, value))

    def indices(self, name: str, length: int) -> tuple[int, ...]:
        """A list of distinct indices below `length`; empty where it is absent."""
        value = self.values.get(name, [])
        if (
            not isinstance(value, list)
            or not all(type(v) is int and 0 <= v < length for v in value)
            or len(set(value)) != len(value)
        ):
            raise self.wrong(name, f"distinct indices below {length}")
        return tuple(value)

    def text(self, name: str, default: str = "") -> str:
        """A string; lone surrogates, which cannot be encoded, become question marks."""
        value = self.values.get(name, default)
        if not isinstance(value, str):
            raise self.wrong(name, "a text")
        return value.encode("utf-8", "replace").decode("utf-8")

    def texts(self, name: str) -> tuple[str, ...]:
        """A list of texts; empty where it is absent."""
        value = self.values.get(name, [])
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            raise self.wrong(name, "a list of texts")
        return tuple(v.encode("utf-8", "replace").decode("utf-8") for v in value)

    def flag(self, name: str, *, default: bool = False) -> bool:
        """A boolean."""
        value = self.values.get(name, default)
        if not isinstance(value, bool):
            raise self.wrong(name, "true or false")
        return value

    def child(self, name: str) -> Fields:
        """An object; an empty one where it is absent."""
        value = self.values.get(name, {})
        if not isinstance(value, dict):
            raise self.wrong(name, "an object")
        return Fields(value, self.at(name))

    def children(self, name: str) -> tuple[Fields, ...]:
        """A list of objects; empty where it is absent."""
        value = self.values.get(name, [])
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise self.wrong(name, "a list of objects")
        place = self.at(name)
        return tuple(Fields(v, f"{place}[{i}]") for i, v in enumerate(value))

    def extension(self, name: str) -> Fields | None:
        """One of the object's extensions; None if absent."""
        extensions = self.child("extensions")
        return extensions.child(name) if name in extensions else None


def _format_value(value: Json) -> str:
    """A value as text, truncated while it is built: a list may be as long as the file."""
    try:
        return reprlib.repr(value)
    except ValueError:  # an integer of more digits than Python writes
        return "a number of very many digits"


def _finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond any float
        return False
