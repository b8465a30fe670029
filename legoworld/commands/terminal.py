"""Terminal output: printed text cannot control the terminal.

Names, labels, reasons and messages come from untrusted files and are printed in many places. All
of them pass through these streams.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TextIO

from legoworld.errors import printable

#: Carriage return, which progress bars need.
_RETURN: Final = "\r"


class PrintableStream:
    """A text stream that writes only `printable` text and otherwise delegates to the stream."""

    def __init__(self, stream: TextIO, *, keep_returns: bool) -> None:
        self._stream = stream
        self._keep_returns = keep_returns

    def write(self, text: str) -> int:
        """Write text with control characters replaced; return the number of characters passed."""
        if self._keep_returns:
            self._stream.write(_RETURN.join(map(printable, text.split(_RETURN))))
        else:
            self._stream.write(printable(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write each line as `write` does."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def printable_streams() -> Iterator[None]:
    """Replace standard output and standard error by `PrintableStream`s within the block."""
    streams: tuple[Any, Any] = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (
        PrintableStream(streams[0], keep_returns=False),
        PrintableStream(streams[1], keep_returns=True),
    )
    try:
        yield
    finally:
        sys.stdout, sys.stderr = streams
