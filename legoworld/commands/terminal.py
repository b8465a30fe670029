"""The one way to the terminal: nothing that is printed can command it.

Names, labels, reasons and messages come from untrusted files and are printed in many places. They
pass here, whatever prints them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, TextIO

from legoworld.errors import printable

#: What progress bars need: back to the line's beginning.
_RETURN: Final = "\r"


class PrintableStream:
    """A text stream that takes `printable` text only; everything else is the stream's own."""

    def __init__(self, stream: TextIO, *, keep_returns: bool) -> None:
        self._stream = stream
        self._keep_returns = keep_returns

    def write(self, text: str) -> int:
        """Write the text, with control characters replaced; the number of characters given."""
        if self._keep_returns:
            self._stream.write(_RETURN.join(map(printable, text.split(_RETURN))))
        else:
            self._stream.write(printable(text))
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write each line as `write` does."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def printable_streams() -> Iterator[None]:
    """Standard output and standard error as `PrintableStream`s for as long as the block lasts."""
    streams: tuple[Any, Any] = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (
        PrintableStream(streams[0], keep_returns=False),
        PrintableStream(streams[1], keep_returns=True),
    )
    try:
        yield
    finally:
        sys.stdout, sys.stderr = streams
