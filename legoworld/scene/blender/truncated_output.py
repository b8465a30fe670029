"""What an agent's code prints: its beginning and its end, never more than fits an answer."""

from __future__ import annotations

import io
from typing import Final

_KEPT: Final = 1 << 19  # characters of each end


class TruncatedOutput(io.TextIOBase):
    """A text stream that keeps both ends of what is written to it."""

    def __init__(self) -> None:
        self._head = ""
        self._tail = ""
        self._left_out = 0

    def writable(self) -> bool:
        """Always true."""
        return True

    def write(self, text: str) -> int:
        """Keep as much as there is room for."""
        room = _KEPT - len(self._head)
        self._head += text[:room]
        self._tail += text[room:] if room > 0 else text
        if len(self._tail) > 2 * _KEPT:
            self._left_out += len(self._tail) - _KEPT
            self._tail = self._tail[-_KEPT:]
        return len(text)

    def text(self) -> str:
        """What was printed; where it was too much, with a word of what is left out."""
        tail, left_out = self._tail[-_KEPT:], self._left_out + max(0, len(self._tail) - _KEPT)
        between = f"\n... {left_out} characters are left out ...\n" if left_out else ""
        return self._head + between + tail
