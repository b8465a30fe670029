"""Messages of Blender MCP's socket: JSON objects one after the other, with or without newlines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

#: What opens, closes or quotes outside of a string, and what ends or escapes inside of one.
_OUTSIDE: Final = re.compile(rb'["{}\[\]]')
_INSIDE: Final = re.compile(rb'["\\]')
_SPACE: Final = b" \t\r\n"
MOST_BYTES: Final = 64 << 20


class FramingError(ValueError):
    """The received data cannot be a message; the text says why."""


class MessageSplitter:
    """Cuts a stream of bytes into JSON objects; a message ends where its first bracket closes.

    Every byte is looked at once, however the stream is cut into pieces. The messages themselves are
    not checked beyond their brackets.
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most = most_bytes
        self._data = bytearray()
        self._at = 0  # where the search resumes
        self._depth = 0
        self._in_string = False
        #: Whether the client ends its messages with newlines, and so wants to read them.
        self.newlines = False

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take received bytes; the messages that they complete.

        Raises FramingError for what begins with no bracket, and for a message without an end.
        """
        self._data += data
        while (message := self._next()) is not None:
            yield message

    def _next(self) -> bytes | None:
        if self._depth == 0:
            self._drop_space()
            if not self._data:
                return None
            if self._data[0] not in b"{[":
                raise FramingError("a message is a JSON object and begins with {")
        end = self._end()
        if end is None:
            if len(self._data) > self._most:
                raise FramingError(f"a message has at most {self._most:,} bytes")
            return None
        message = bytes(self._data[:end])
        del self._data[:end]
        self._at = 0
        self._drop_space()
        return message

    def _drop_space(self) -> None:
        rest = self._data.lstrip(_SPACE)
        space = self._data[: len(self._data) - len(rest)]
        self.newlines = self.newlines or b"\n" in space
        self._data = rest

    def _end(self) -> int | None:
        """End of the first message in the data; None while it is incomplete."""
        while True:
            match = (_INSIDE if self._in_string else _OUTSIDE).search(self._data, self._at)
            if match is None:
                self._at = len(self._data)
                return None
            at, byte = match.start(), match[0]
            if byte == b"\\":
                if at + 1 == len(self._data):  # what it escapes is yet to come
                    self._at = at
                    return None
                self._at = at + 2
                continue
            self._at = at + 1
            if byte == b'"':
                self._in_string = not self._in_string
            else:
                self._depth += 1 if byte in b"{[" else -1
                if self._depth == 0:
                    return self._at
