"""Many texts in one block of memory."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from io import BytesIO
from typing import Final, overload

import numpy as np
from numpy.typing import NDArray

#: Number of positions looked up together.
_BLOCK: Final = 1 << 16
#: JSON may hold halves of surrogate pairs; that no mask does is checked later.
_ENCODING: Final = ("utf-8", "surrogatepass")


class Texts(Sequence[str]):
    """Texts that are created on access.

    The texts of a results list are allocated between its numbers and dicts: kept individually, they
    would keep the memory around them from being freed.
    """

    def __init__(self, data: bytes, start: NDArray[np.int64]) -> None:
        """data: UTF-8; start: (n + 1,) the start of each text, and the end."""
        self._data = data
        self._start = start

    def take(self, places: NDArray[np.int64]) -> Texts:
        """The texts at these positions, in their order."""
        taken = TextBuilder()
        for text in self._encoded(places):
            taken.add_encoded(text)
        return taken.texts()

    def _encoded(self, places: NDArray[np.int64]) -> Iterator[bytes]:
        for some in np.array_split(places, len(places) // _BLOCK + 1):
            for a, b in zip(
                self._start[some].tolist(), self._start[some + 1].tolist(), strict=True
            ):
                yield self._data[a:b]

    def __len__(self) -> int:
        return len(self._start) - 1

    def __iter__(self) -> Iterator[str]:
        return map(self.__getitem__, range(len(self)))

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        """The text at a position, or those of a slice."""
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        return self._data[self._start[index] : self._start[index + 1]].decode(*_ENCODING)


class TextBuilder:
    """Texts put together one by one: no list of millions of them is made beside the one piece."""

    def __init__(self) -> None:
        self._data, self._start = BytesIO(), array("q", [0])

    def add(self, text: str) -> None:
        """Put one text behind the others."""
        self.add_encoded(text.encode(*_ENCODING))

    def add_encoded(self, text: bytes) -> None:
        """The same of its UTF-8."""
        self._data.write(text)
        self._start.append(self._data.tell())

    def texts(self) -> Texts:
        """All of them."""
        return Texts(self._data.getvalue(), np.array(self._start, np.int64))
