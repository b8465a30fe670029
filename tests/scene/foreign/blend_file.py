"""The block structure of an uncompressed .blend file, enough to damage one block at a time.

Up to Blender 4.5 the file begins with 12 bytes (BLENDER, pointer size, byte order, version) and a
block's header has 20 or 24 bytes; 5.0 writes 17 bytes and headers of 32. Source: Blender's
`BLO_core_bhead.hh` and `BLO_core_blend_header.hh`.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final, Literal

Field = Literal["code", "length", "old_pointer", "struct", "count"]


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Where the first block begins, and how a block's header is packed.

    format: struct's, of the fields in `order`.
    """

    first_block: int
    format: str
    order: tuple[Field, ...]

    @property
    def header_bytes(self) -> int:
        """Bytes of one block header."""
        return struct.calcsize(self.format)


@dataclass(frozen=True, kw_only=True)
class Block:
    """One block: its header begins at `start`, its content ends before `end`."""

    code: bytes
    start: int
    body: int
    end: int


_OLD_ORDER: Final[tuple[Field, ...]] = ("code", "length", "old_pointer", "struct", "count")
_NEW_ORDER: Final[tuple[Field, ...]] = ("code", "struct", "old_pointer", "length", "count")


def layout_of(data: bytes) -> Layout:
    """How the file's headers are packed. ValueError when it is no uncompressed .blend."""
    if not data.startswith(b"BLENDER"):
        raise ValueError("not an uncompressed .blend")
    if data[7:8] in (b"-", b"_"):
        order = "<" if data[8:9] == b"v" else ">"
        pointer = "Q" if data[7:8] == b"-" else "I"
        return Layout(first_block=12, format=f"{order}4si{pointer}ii", order=_OLD_ORDER)
    if data[7:9] == b"17":
        return Layout(first_block=17, format="<4siQqq", order=_NEW_ORDER)
    raise ValueError(f"unknown header {data[:17]!r}")


def blocks_of(data: bytes) -> list[Block]:
    """All blocks up to and including ENDB."""
    layout = layout_of(data)
    found, at = [], layout.first_block
    while at + layout.header_bytes <= len(data):
        fields = dict(zip(layout.order, struct.unpack_from(layout.format, data, at), strict=True))
        body = at + layout.header_bytes
        found.append(Block(code=fields["code"], start=at, body=body, end=body + fields["length"]))
        at = found[-1].end
        if fields["code"] == b"ENDB":
            break
    return found


def field_range(data: bytes, block: Block, field: Field) -> tuple[int, int]:
    """First byte and end of one field of a block's header."""
    layout = layout_of(data)
    at = block.start
    prefix, codes = layout.format[0], layout.format[1:].replace("4s", "I")
    for name, code in zip(layout.order, codes, strict=True):
        size = struct.calcsize(prefix + code)
        if name == field:
            return at, at + size
        at += size
    raise ValueError(field)
