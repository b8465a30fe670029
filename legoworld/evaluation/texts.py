"""Many texts in one piece of memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray


class Texts(Sequence[str]):
    """Texts that are made each time they are asked for.

    The texts of a results list lie between its numbers and dicts: kept one by one, they would keep
    the memory of everything around them.
    """

    def __init__(self, data: bytes, start: NDArray[np.int64]) -> None:
        """data: UTF-8; start: (n + 1,) where each text begins, and the end."""
        self._data = data
        self._start = start

    def take(self, places: NDArray[np.int64]) -> Texts:
        """The texts at these places, in their order."""
        start, end = self._start[places].tolist(), self._start[places + 1].tolist()
        return _joined([self._data[a:b] for a, b in zip(start, end, strict=True)])

    def __len__(self) -> int:
        return len(self._start) - 1

    def __iter__(self) -> Iterator[str]:
        return map(self.__getitem__, range(len(self)))

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: Any) -> Any:
        """The text at a place, or those of a slice."""
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        return self._data[self._start[index] : self._start[index + 1]].decode(*_ENCODING)


#: JSON may hold halves of surrogate pairs; that no mask does is checked later.
_ENCODING = ("utf-8", "surrogatepass")


def texts_of(texts: Sequence[str]) -> Texts:
    """The same texts."""
    return _joined([text.encode(*_ENCODING) for text in texts])


def _joined(encoded: list[bytes]) -> Texts:
    start = np.zeros(len(encoded) + 1, np.int64)
    np.cumsum([len(text) for text in encoded], out=start[1:])
    return Texts(b"".join(encoded), start)
