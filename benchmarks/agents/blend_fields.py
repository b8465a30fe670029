"""What differs between two .blend files, by the names that the files themselves have for it."""

from __future__ import annotations

import re
import struct
import subprocess
from collections import Counter
from pathlib import Path

_BLOCK = struct.Struct("<4siQqq")


def blend(path: Path) -> bytes:
    """A .blend of Blender 5.0 as it is before it is compressed."""
    return subprocess.run(["zstd", "-dcq", str(path)], capture_output=True, check=True).stdout


def blocks(data: bytes) -> list[tuple[bytes, int, int, bytes]]:
    """Code, struct, address and content of each block."""
    at, found = 17, []
    while at < len(data):
        code, kind, address, length, _ = _BLOCK.unpack_from(data, at)
        at += _BLOCK.size
        found.append((code, kind, address, data[at : at + length]))
        at += length
    return found


class Names:
    """The structs that a .blend names in its block DNA1."""

    def __init__(self, dna: bytes) -> None:
        self.dna, self.at = dna, 8
        self.fields = self._texts()
        self.at += 4
        self.types = self._texts()
        self.at += 4
        self.sizes = struct.unpack_from(f"<{len(self.types)}H", dna, self.at)
        self.at = (self.at + 2 * len(self.types) + 3) // 4 * 4 + 4
        self.structs = []
        for _ in range(self._number("<i")):
            kind = self._number("<H")
            members = [(self._number("<H"), self._number("<H")) for _ in range(self._number("<H"))]
            self.structs.append((kind, members))

    def _number(self, form: str) -> int:
        (value,) = struct.unpack_from(form, self.dna, self.at)
        self.at += struct.calcsize(form)
        return int(value)

    def _texts(self) -> list[str]:
        found = []
        for _ in range(self._number("<i")):
            end = self.dna.index(b"\0", self.at)
            found.append(self.dna[self.at : end].decode())
            self.at = end + 1
        self.at = (self.at + 3) // 4 * 4
        return found

    def member(self, kind: int, offset: int) -> str:
        """The member of a struct, or of an array of it, that an offset is in."""
        name, members = self.structs[kind]
        at, offset = 0, offset % self.sizes[name]
        for of, field in members:
            text = self.fields[field]
            count = 1
            for size in re.findall(r"\[(\d+)\]", text):
                count *= int(size)
            at += count * (8 if text.startswith(("*", "(*")) else self.sizes[of])
            if offset < at:
                return f"{self.types[name]}.{text}"
        return f"{self.types[name]}: padding"


def differing(one: bytes, other: bytes) -> Counter[str]:
    """Bytes that differ, by member."""
    ours, theirs = blocks(one), blocks(other)
    names = Names(next(content for code, _, _, content in ours if code == b"DNA1"))
    found: Counter[str] = Counter()
    if len(ours) != len(theirs):
        found["blocks"] = abs(len(ours) - len(theirs))
    for (_, kind, address, content), (_, _, again, content_again) in zip(
        ours, theirs, strict=False
    ):
        found["addresses of blocks"] += address != again
        found["lengths of blocks"] += len(content) != len(content_again)
        for at, (a, b) in enumerate(zip(content, content_again, strict=False)):
            if a != b:
                found[names.member(kind, at)] += 1
    return +found
