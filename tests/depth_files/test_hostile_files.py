"""Depth files that claim too much, are cut, or are no depth: one error each, and little memory."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zipfile
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from depth_files.array_files import npy, npz
from hypothesis import given
from hypothesis import strategies as st

from legoworld.depth_files import read_depth
from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import MOST_PX
from legoworld.depth_files.read_depth import npz_arrays
from legoworld.evaluation.depth.arrays import Declaration, DepthTruthError, read_declaration
from legoworld.evaluation.depth.labelled import read_labelled

IN_METRES = Declaration(space="depth", unit="m/256")
DEPTH = np.random.default_rng(0).uniform(0.5, 60, (5, 7)).astype(np.float32)
SIDE = 200_000
JUST_TOO_MANY = (MOST_PX // 4096 + 1, 4096)


def zeros_npz(shape: tuple[int, ...]) -> bytes:
    """A true zip bomb: every byte that the header of its member claims, deflated."""
    stream = io.BytesIO()
    with (
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("values.npy", "w", force_zip64=True) as member,
    ):
        member.write(npy(shape, "<f8"))
        for _ in range(shape[0]):
            member.write(bytes(8 * shape[1]))
    return stream.getvalue()


def png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    pixels = zlib.compress(bytes(1000))
    parts = chunk(b"IHDR", header), chunk(b"IDAT", pixels), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def tiff(width: int, height: int, *, order: str = "<", big: bool = False) -> bytes:
    """An uncompressed float32 TIFF without pixels."""
    fields = [(256, width), (257, height), (258, 32), (259, 1), (262, 1), (273, 8), (277, 1)]
    fields += [(278, height), (279, 4), (339, 3)]
    mark = b"II" if order == "<" else b"MM"
    if big:
        start = mark + struct.pack(order + "HHHQQ", 43, 8, 0, 16, len(fields))
        entry, end = "HHQQ", struct.pack(order + "Q", 0)
    else:
        start = mark + struct.pack(order + "HIH", 42, 8, len(fields))
        entry, end = "HHII", struct.pack(order + "I", 0)
    kind = 16 if big else 4
    return start + b"".join(struct.pack(order + entry, t, kind, 1, v) for t, v in fields) + end


CLAIMS = {
    "cut.npy": npy((SIDE, SIDE)),
    "cut.npz": npz(npy((SIDE, SIDE))),
    "overflow.npy": npy((1 << 62, 1 << 62)),
    "axes.npy": npy((1, SIDE, SIDE, 1)),
    "negative.npy": npy((-5, -7), data=bytes(140)),
    "negative.npz": npz(npy((-1, 7), data=bytes(140))),
    "empty.npy": npy((0, 7)),
    "objects.npy": npy((5, 7), "|O", bytes(280)),
    "objects.npz": npz(npy((5, 7), "|O", bytes(280))),
    "deep.npy": b"\x93NUMPY\x01\x00" + struct.pack("<H", 9000) + b"(" * 9000,
    "huge-label.npz": npz(npy((2000,), "<U1", bytes(8000)), name="space.npy"),
    "a.pfm": f"Pf\n{SIDE} {SIDE}\n-1\n".encode(),
    "negative.pfm": b"Pf\n-5 -7\n-1\n" + bytes(140),
    "a.png": png(SIDE, SIDE),
    "bomb.png": png(*JUST_TOO_MANY),
    "chunk.png": png(7, 5)[:33] + b"\xd1" + png(7, 5)[34:],  # a chunk of 3.5 GB
    "first-chunk.png": png(7, 5)[:8] + b"\xc6" + png(7, 5)[9:],
    "without-end.png": png(7, 5)[:-12],
    "a.pgm": f"P5 {SIDE} {SIDE} 65535\n".encode(),
    "ascii.pgm": f"P2 {SIDE} {SIDE} 65535\n1 2 3".encode(),
    "a.tiff": tiff(SIDE, SIDE),
    "motorola.tif": tiff(SIDE, SIDE, order=">"),
    "big.tif": tiff(SIDE, SIDE, big=True),
    "nothing.tif": b"II*\0\x08\0\0\0\0\0\0\0\0\0",
}


@pytest.mark.parametrize("name", CLAIMS)
def test_a_header_that_claims_too_much_costs_nothing(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(CLAIMS[name])
    tracemalloc.start()
    try:
        with pytest.raises(DepthFileError):
            read_labelled(tmp_path / name, IN_METRES)
        assert tracemalloc.get_traced_memory()[1] < 4 << 20
    finally:
        tracemalloc.stop()


def test_an_exr_that_claims_too_much(tmp_path: Path) -> None:
    openexr = pytest.importorskip("OpenEXR", reason="OpenEXR is not installed")
    path = tmp_path / "a.exr"
    openexr.File({"type": openexr.scanlineimage}, {"Z": DEPTH}).write(str(path))
    window = struct.pack("<4i", 0, 0, 6, 4)
    bytes_now = path.read_bytes()
    assert bytes_now.count(window) == 2  # dataWindow and displayWindow
    path.write_bytes(bytes_now.replace(window, struct.pack("<4i", 0, 0, SIDE - 1, SIDE - 1)))
    with pytest.raises(DepthFileError, match=r"a\.exr"):
        read_labelled(path, IN_METRES)
    path.write_bytes(bytes_now.replace(window, struct.pack("<4i", 5, 5, 0, 0)))
    with pytest.raises(DepthFileError, match=r"a\.exr"):
        read_labelled(path, IN_METRES)


def test_a_zip_bomb_is_refused_by_the_caller_s_size(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(zeros_npz((4096, 4096)))
    assert (tmp_path / "a.npz").stat().st_size < 1 << 18
    told = []

    def refuse(size_wh: tuple[int, int]) -> None:
        told.append(size_wh)
        raise DepthFileError("not this size")

    tracemalloc.start()
    try:
        with pytest.raises(DepthFileError, match="not this size"):
            read_labelled(tmp_path / "a.npz", IN_METRES, check_size=refuse)
        assert tracemalloc.get_traced_memory()[1] < 4 << 20
    finally:
        tracemalloc.stop()
    assert told == [(4096, 4096)]


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".pfm", ".exr", ".png", ".pgm", ".tiff"])
def test_every_format_tells_its_size_before_it_is_read(tmp_path: Path, suffix: str) -> None:
    path = write(tmp_path / f"a{suffix}")
    told = []
    array = read_labelled(path, IN_METRES, check_size=told.append)
    assert told == [(7, 5)] == [array.size_wh]


def write(path: Path) -> Path:
    """DEPTH in the format that the path's suffix names; integers where it must be."""
    integers = (DEPTH * 256).astype(np.uint16)
    if path.suffix == ".npy":
        np.save(path, DEPTH)
    elif path.suffix == ".npz":
        np.savez(path, values=DEPTH)
    elif path.suffix == ".pfm":
        path.write_bytes(b"Pf\n7 5\n-1\n" + DEPTH[::-1].tobytes())
    elif path.suffix == ".exr":
        openexr = pytest.importorskip("OpenEXR", reason="OpenEXR is not installed")
        openexr.File({"type": openexr.scanlineimage}, {"Z": DEPTH}).write(str(path))
    else:
        cv2.imwrite(str(path), DEPTH if path.suffix == ".tiff" else integers)
    return path


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".pfm", ".exr", ".png", ".pgm", ".tiff"])
def test_damage_of_any_kind_is_a_depth_file_error(
    tmp_path_factory: pytest.TempPathFactory, suffix: str
) -> None:
    folder = tmp_path_factory.mktemp("damage")
    whole = write(folder / f"whole{suffix}").read_bytes()
    damaged = folder / f"a{suffix}"

    def of_this_size(size_wh: tuple[int, int]) -> None:
        if size_wh != (7, 5):
            raise DepthFileError("another size")

    @given(
        end=st.integers(0, len(whole)),
        flips=st.lists(st.tuples(st.integers(0, len(whole) - 1), st.integers(1, 255)), max_size=4),
    )
    def one(end: int, flips: list[tuple[int, int]]) -> None:
        changed = bytearray(whole)
        for place, mask in flips:
            changed[place] ^= mask
        damaged.write_bytes(changed[:end] if end % 3 else changed)
        try:
            array = read_labelled(damaged, IN_METRES, check_size=of_this_size)
        except DepthFileError:
            return
        assert array.values.shape == (5, 7)

    one()


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_an_npz_packed_in_another_way(tmp_path: Path, compression: int) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", compression) as archive:
        archive.writestr("values.npy", npy((5, 7), data=DEPTH.tobytes()))
    with pytest.raises(DepthFileError, match="compressed in a way"):
        read_labelled(tmp_path / "a.npz", IN_METRES)


def test_two_arrays_of_one_name(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("values.npy", npy((5, 7), data=DEPTH.tobytes()))
        archive.writestr("values", npy((5, 7), data=DEPTH.tobytes()))
    with pytest.raises(DepthFileError, match="two arrays of one name"):
        read_labelled(tmp_path / "a.npz", IN_METRES)


def test_no_memory_is_an_error_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_args: Any, **_kwargs: Any) -> None:
        raise MemoryError

    np.save(tmp_path / "a.npy", DEPTH)
    monkeypatch.setattr(np.lib.format, "read_array", full)
    with pytest.raises(DepthFileError, match="does not fit into memory"):
        read_labelled(tmp_path / "a.npy", IN_METRES)


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", f"1{'0' * 400}"])
def test_a_declaration_holds_finite_numbers_only(tmp_path: Path, number: str) -> None:
    (tmp_path / "depth.toml").write_text(f"focal_px = {number}\n")
    with pytest.raises(DepthTruthError, match=r"depth\.toml has an unknown key or value"):
        read_declaration(tmp_path)
    (tmp_path / "depth.toml").write_text("array = " + "[" * 5000)
    with pytest.raises(DepthTruthError, match=r"depth\.toml cannot be read"):
        read_declaration(tmp_path)


def test_arrays_that_are_read_at_once_are_counted_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "many.npz"
    np.savez_compressed(path, a=np.zeros((2, 2)), b=np.zeros((2, 2)), c=np.zeros((99, 99)))
    assert sorted(npz_arrays(path, path.name, "ab")) == ["a", "b"]
    monkeypatch.setattr(read_depth, "_MOST_BYTES", 10_000)
    monkeypatch.setattr(read_depth, "_plain_numbers", lambda _: pytest.fail("read"))
    with pytest.raises(DepthFileError, match=r"7[0-9],[0-9]+ bytes of arrays, more than 10,000"):
        npz_arrays(path, path.name)
