"""Many texts in one block of memory."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from io import BytesIO
from itertools import accumulate
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
        """The texts at these (n,) positions, in their order."""
        taken = TextBuilder()
        for some in np.array_split(places, len(places) // _BLOCK + 1):
            ends = zip(self._start[some].tolist(), self._start[some + 1].tolist(), strict=True)
            taken.add_encoded([self._data[a:b] for a, b in ends])
        return taken.texts()

    def piece(self, first: int, end: int) -> tuple[bytes, NDArray[np.int64]]:
        """The UTF-8 of n texts from one place to another, and where each starts in it, (n + 1,)."""
        start = self._start[first : end + 1]
        return self._data[start[0] : start[-1]], start - start[0]

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
    """Texts put together some at a time: no list of millions is made beside the one piece."""

    def __init__(self) -> None:
        self._data, self._start = BytesIO(), array("q", [0])

    def add(self, texts: Iterable[str]) -> None:
        """Put texts behind those that are there."""
        self.add_encoded([text.encode(*_ENCODING) for text in texts])

    def add_encoded(self, texts: Sequence[bytes]) -> None:
        """The same of their UTF-8."""
        at = self._data.tell()
        self._data.write(b"".join(texts))
        self._start.extend([at + end for end in accumulate(map(len, texts))])

    def texts(self) -> Texts:
        """All of them."""
        return Texts(self._data.getvalue(), np.array(self._start, np.int64))


def pack_texts(texts: Iterable[str]) -> Texts:
    """The same texts."""
    built = TextBuilder()
    built.add(texts)
    return built.texts()
