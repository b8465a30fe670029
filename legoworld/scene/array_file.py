"""Named arrays in one file: an index, then the arrays as in memory.

    legoworld arrays 1
    <crc32 of everything after this line, 8 hex digits; 8 dashes in one that is only passed on>
    [[name, dtype, shape, offset], ...]
    padding, array, padding, array, padding ...

Offsets are from the end of the padding after the third line, and multiples of `_ALIGNMENT`. It
holds what an uncompressed .npz holds, and is read nine times as fast while the arrays are small.
"""

from __future__ import annotations

import json
import math
import os
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.files import atomic_path, canonical_json

_FORMAT: Final = b"legoworld arrays 1\n"
_UNCHECKED: Final = b"--------\n"
_CHECKED_FROM: Final = len(_FORMAT) + 9
_ALIGNMENT: Final = 64


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], *, passing: bool = False) -> None:
    """Write arrays of any shape atomically; equal arrays give equal bytes.

    passing: for the process that waits for it, which reads it once. It is written over what the
    file held before, whose memory the system then need not take away and give again, and without
    a checksum.
    """
    index: list[list[Any]] = []
    parts: list[memoryview | bytes] = []
    offset = 0
    for name, array in arrays.items():
        index.append([name, array.dtype.str, list(array.shape), offset])
        data = np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
        parts += [data, bytes(-data.nbytes % _ALIGNMENT)]
        offset += len(parts[-2]) + len(parts[-1])
    line = canonical_json(index).encode("utf-8") + b"\n"
    parts = [line, bytes(-(_CHECKED_FROM + len(line)) % _ALIGNMENT), *parts]
    if passing:
        kept = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)  # not truncated
        with os.fdopen(kept, "wb") as stream:
            stream.write(_FORMAT + _UNCHECKED)
            stream.writelines(parts)
            stream.truncate()
        return
    checksum = 0
    for part in parts:
        checksum = zlib.crc32(part, checksum)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(_FORMAT + _checksum_line(checksum))
        stream.writelines(parts)


def read_arrays(path: Path, *, passing: bool = False) -> dict[str, NDArray[Any]]:
    """A file's arrays, shapes kept, read-only. ValueError or OSError if the file is damaged.

    passing: as it was written.
    """
    content = path.read_bytes()
    if not content.startswith(_FORMAT):
        raise ValueError("it is not a legoworld array file")
    checked = memoryview(content)[_CHECKED_FROM:]
    expected = _UNCHECKED if passing else _checksum_line(zlib.crc32(checked))
    if content[len(_FORMAT) : _CHECKED_FROM] != expected:
        raise ValueError("it is damaged: its checksum is another one")
    end = content.index(b"\n", _CHECKED_FROM) + 1
    index = json.loads(content[_CHECKED_FROM:end])
    return dict(_views(memoryview(content)[end + -end % _ALIGNMENT :], index))


def _checksum_line(checksum: int) -> bytes:
    return b"%08x\n" % checksum


def _views(
    data: memoryview, index: list[tuple[str, str, list[int], int]]
) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, dtype, shape, offset in index:
        count = math.prod(shape)
        yield name, np.frombuffer(data, np.dtype(dtype), count, offset).reshape(shape)
