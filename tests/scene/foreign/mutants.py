"""Damaged .blend files: the same seed and number give the same bytes."""

from __future__ import annotations

import gzip
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from scene.foreign.blend_file import Block, Field, blocks_of, field_range

#: What a corrupt or hostile file puts where a count, an index or a coordinate belongs.
_EXTREMES: Final = (
    b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\x00\x00\x00\x00",
    struct.pack("<f", float("nan")), struct.pack("<f", float("inf")), struct.pack("<f", 1e38),
)  # fmt: skip
_TRIES: Final = 100  # zeroing what is zero already does nothing
#: Blocks that decide what is seen; half of all damage goes there and to what follows them.
_TELLING: Final = (b"SC", b"OB", b"ME", b"CA", b"GR", b"MA", b"NT", b"CU", b"TE", b"PA", b"IM")


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """One damaged file. kind: what was done to it."""

    kind: str
    data: bytes


def mutant(source: bytes, *, seed: int, number: int) -> Mutant:
    """Mutant `number` of a .blend; the kinds of damage take turns.

    A gzip file is damaged inside and packed again; a Zstandard file is damaged as it is.
    """
    rng = random.Random(f"{seed}/{number}")
    if source.startswith(b"\x1f\x8b") and number % 2:
        inner = mutant(gzip.decompress(source), seed=seed, number=number // 2)
        return Mutant(
            kind=f"gzip: {inner.kind}", data=gzip.compress(inner.data, compresslevel=1, mtime=0)
        )
    kinds = _OF_BLOCKS if source.startswith(b"BLENDER") else _OF_BYTES
    turn = number // 2 if source.startswith(b"\x1f\x8b") else number
    name, damage = list(kinds.items())[turn % len(kinds)]
    for _ in range(_TRIES):
        data = damage(rng, source)
        if data != source:
            return Mutant(kind=name, data=data)
    raise ValueError(f"{name} leaves the file as it is")


def _truncate(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data))]


def _truncate_tail(rng: random.Random, data: bytes) -> bytes:
    return data[: -rng.randrange(1, min(2000, len(data)))]


def _flip_bits(rng: random.Random, data: bytes) -> bytes:
    return _flipped(rng, data, 0, len(data), rng.choice((1, 4, 16, 256)))


def _zero_range(rng: random.Random, data: bytes) -> bytes:
    start = rng.randrange(len(data))
    length = min(rng.choice((8, 256, 8192)), len(data) - start)
    return data[:start] + bytes(length) + data[start + length :]


def _repeat_range(rng: random.Random, data: bytes) -> bytes:
    start = rng.randrange(len(data))
    return data[: start + 1000] + data[start:]


def _file_header(rng: random.Random, data: bytes) -> bytes:
    return _flipped(rng, data, 0, 17, rng.choice((1, 3)))


def _truncate_at_block(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.choice(blocks_of(data)).start]


def _truncate_in_header(rng: random.Random, data: bytes) -> bytes:
    block = rng.choice(blocks_of(data))
    return data[: rng.randrange(block.start + 1, block.body)]


def _field_bits(field: Field) -> Callable[[random.Random, bytes], bytes]:
    def damage(rng: random.Random, data: bytes) -> bytes:
        start, end = field_range(data, _block(rng, data), field)
        return _flipped(rng, data, start, end, rng.choice((1, 2)))

    return damage


def _huge_length(rng: random.Random, data: bytes) -> bytes:
    start, end = field_range(data, _block(rng, data), "length")
    value = rng.choice((0, 2**31 - 1, -1, len(data), -(2**31)))
    return data[:start] + value.to_bytes(end - start, "little", signed=True) + data[end:]


def _swap_fields(field: Field) -> Callable[[random.Random, bytes], bytes]:
    def damage(rng: random.Random, data: bytes) -> bytes:
        ranges = sorted(field_range(data, _block(rng, data), field) for _ in range(2))
        (a, b), (c, d) = ranges
        return data if a == c else data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]

    return damage


def _description_bits(rng: random.Random, data: bytes) -> bytes:
    """Bits of DNA1, which says how every struct of the file is laid out."""
    for block in blocks_of(data):
        if block.code == b"DNA1":
            return _flipped(rng, data, block.body, block.end, rng.choice((1, 8, 64)))
    return data


def _extreme_values(rng: random.Random, data: bytes) -> bytes:
    block = _block(rng, data)
    out = bytearray(data)
    for _ in range(rng.choice((1, 3, 10))):
        if block.end - block.body >= 4:
            at = block.body + 4 * rng.randrange((block.end - block.body) // 4)
            out[at : at + 4] = rng.choice(_EXTREMES)
    return bytes(out)


def _zero_block(rng: random.Random, data: bytes) -> bytes:
    block = _block(rng, data)
    return data[: block.body] + bytes(block.end - block.body) + data[block.end :]


def _repeat_block(rng: random.Random, data: bytes) -> bytes:
    block = _block(rng, data)
    return data[: block.end] + data[block.start : block.end] + data[block.end :]


def _drop_block(rng: random.Random, data: bytes) -> bytes:
    block = _block(rng, data)
    return data[: block.start] + data[block.end :]


def _swap_blocks(rng: random.Random, data: bytes) -> bytes:
    one, other = sorted((_block(rng, data), _block(rng, data)), key=lambda b: b.start)
    if one.start == other.start:
        return data
    first, second = data[one.start : one.end], data[other.start : other.end]
    return data[: one.start] + second + data[one.end : other.start] + first + data[other.end :]


def _block(rng: random.Random, data: bytes) -> Block:
    blocks = blocks_of(data)
    telling = [i for i, b in enumerate(blocks) if b.code.rstrip(b"\0") in _TELLING]
    if telling and rng.random() < 0.5:
        # The block itself or one of the DATA blocks that follow it.
        return blocks[min(rng.choice(telling) + rng.choice((0, 0, 1, 2, 3)), len(blocks) - 1)]
    return rng.choice(blocks)


def _flipped(rng: random.Random, data: bytes, start: int, end: int, count: int) -> bytes:
    out = bytearray(data)
    for _ in range(count):
        out[rng.randrange(start, min(end, len(data)))] ^= 1 << rng.randrange(8)
    return bytes(out)


_OF_BYTES: Final[dict[str, Callable[[random.Random, bytes], bytes]]] = {
    "truncated": _truncate,
    "tail lost": _truncate_tail,
    "bits flipped": _flip_bits,
    "range zeroed": _zero_range,
    "range repeated": _repeat_range,
    "file header": _file_header,
}
_OF_BLOCKS: Final[dict[str, Callable[[random.Random, bytes], bytes]]] = {
    **_OF_BYTES,
    "cut at a block": _truncate_at_block,
    "cut in a block header": _truncate_in_header,
    "block code bits": _field_bits("code"),
    "block length bits": _field_bits("length"),
    "block pointer bits": _field_bits("old_pointer"),
    "block struct bits": _field_bits("struct"),
    "block count bits": _field_bits("count"),
    "block length extreme": _huge_length,
    "lengths swapped": _swap_fields("length"),
    "pointers swapped": _swap_fields("old_pointer"),
    "structs swapped": _swap_fields("struct"),
    "description bits": _description_bits,
    "extreme values": _extreme_values,
    "block zeroed": _zero_block,
    "block repeated": _repeat_block,
    "block dropped": _drop_block,
    "blocks swapped": _swap_blocks,
}

KINDS: Final = tuple(_OF_BLOCKS)
