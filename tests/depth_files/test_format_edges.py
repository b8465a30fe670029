"""Depth formats at the edge of what is read: the last size that is, the first that is not."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import MOST_PX, check_claim, picture_shape, tiff_claim
from legoworld.depth_files.read_depth import files_named, read_pfm, read_picture
from legoworld.evaluation.depth.arrays import (
    DECLARATION,
    Declaration,
    DepthArray,
    DepthTruthError,
    in_range,
    read_declaration,
)
from legoworld.evaluation.depth.labelled import is_unit, metres, per_metre, read_labelled
from legoworld.evaluation.pixels.labelled import claimed_size, declare

DEPTH = np.random.default_rng(0).uniform(0.5, 60, (5, 7)).astype(np.float32)
IN_METRES = Declaration(space="depth", unit="m")


@pytest.mark.parametrize(
    ("shape", "picture"),
    [
        ((5, 7), (5, 7)),
        ((1, 5, 7), (5, 7)),
        ((5, 7, 1), (5, 7)),
        ((1, 1, 5, 7, 1), (5, 7)),
        ((1, 7), (1, 7)),
        ((5, 1), (5, 1)),
        ((1, 1, 7), (1, 7)),
        ((2, 5, 7), (2, 5, 7)),
        ((5, 7, 2), (5, 7, 2)),
        ((7,), (7,)),
    ],
)
def test_only_axes_of_length_one_around_a_picture_are_dropped(shape: Any, picture: Any) -> None:
    assert picture_shape(shape) == picture


def test_the_largest_picture_and_one_pixel_more() -> None:
    told: list[tuple[int, int]] = []
    check_claim(Path("a.npy"), (1, MOST_PX), told.append)
    check_claim(Path("a.npy"), (1 << 14, 1 << 14), told.append)
    assert told == [(MOST_PX, 1), (1 << 14, 1 << 14)]
    for shape in ((1, MOST_PX + 1), ((1 << 14) + 1, 1 << 14)):
        with pytest.raises(
            DepthFileError, match=f"claims an impossible image size.*at most {MOST_PX} pixels"
        ):
            check_claim(Path("a.npy"), shape, None)
    for none in ((0, 7), (5, 0), (5,), (5, 7, 3)):
        with pytest.raises(DepthFileError, match="not one depth image"):
            check_claim(Path("a.npy"), none, None)


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_both_versions_of_npy_that_numpy_writes_for_numbers(tmp_path: Path, version: Any) -> None:
    with (tmp_path / "a.npy").open("wb") as stream:
        np.lib.format.write_array(stream, DEPTH, version=version)
    assert np.array_equal(read_labelled(tmp_path / "a.npy", IN_METRES).values, DEPTH)
    size_wh = claimed_size(
        tmp_path / "a.npy", lambda path, stop: read_labelled(path, IN_METRES, check_size=stop)
    )
    assert size_wh == (7, 5)
    whole = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(whole[:-1])
    with pytest.raises(DepthFileError, match="139 bytes of numbers; expected: 140 for float32"):
        read_labelled(tmp_path / "a.npy", IN_METRES)


def test_a_label_of_4096_bytes_and_a_longer_one(tmp_path: Path) -> None:
    def padded(bytes_of_member: int) -> Path:
        letters = (bytes_of_member - 128) // 4  # a header of numpy is 128 bytes, a letter 4
        np.savez(tmp_path / "a.npz", values=DEPTH, space=np.array("depth", f"<U{letters}"))
        return tmp_path / "a.npz"

    assert np.array_equal(read_labelled(padded(4096), Declaration(unit="m")).values, DEPTH)
    with pytest.raises(DepthFileError, match=r"space\.npy has 4100 bytes and is no label"):
        read_labelled(padded(4100), Declaration(unit="m"))


@pytest.mark.parametrize("comments", [b"", b"# a\n", b"# a\n# b\n"])
def test_comments_between_a_pfm_s_mark_and_its_size(tmp_path: Path, comments: bytes) -> None:
    path = tmp_path / "a.pfm"
    path.write_bytes(b"Pf\n" + comments + b"7 5\n-1\n" + DEPTH[::-1].tobytes())
    assert np.array_equal(read_pfm(path), DEPTH)
    path.write_bytes(path.read_bytes() + b"x")
    with pytest.raises(DepthFileError, match="141 bytes of pixels; expected: 140 = 4 x 7 x 5"):
        read_pfm(path)


def test_a_pgm_has_two_bytes_a_pixel_from_256_on(tmp_path: Path) -> None:
    path = tmp_path / "a.pgm"
    stored = (np.arange(8).reshape(2, 4) * 30).astype(">u2")
    in_mm = Declaration(space="depth", unit="mm")
    path.write_bytes(b"P5 4 2 256\n" + stored.tobytes())
    assert np.array_equal(read_labelled(path, in_mm).values, stored / 1000)
    path.write_bytes(b"P5 # how wide\n4 2\n# the largest\n65535\n" + stored.tobytes())
    assert np.array_equal(read_labelled(path, in_mm).values, stored / 1000)
    path.write_bytes(b"P5 4 99 256\n" + stored.tobytes())
    with pytest.raises(DepthFileError, match="expected: 792 for 4x99"):
        read_labelled(path, in_mm)
    path.write_bytes(b"P5 4 99 255\n" + stored.tobytes())
    with pytest.raises(DepthFileError, match="expected: 396 for 4x99"):
        read_labelled(path, in_mm)
    for words in (b"P5 4 2", b"P6 4 2 256\n", b"P5 4 x 256\n"):
        path.write_bytes(words)
        with pytest.raises(DepthFileError, match="a 16-bit PGM"):
            read_labelled(path, in_mm)


def directory(order: str, fields: dict[int, tuple[int, int]], following: int = 0) -> bytes:
    """A TIFF that is one directory; fields: tag -> (type, value)."""
    letters = {1: "B3x", 3: "H2x", 4: "I"}
    entries = b"".join(
        struct.pack(order + "HHI" + letters[kind], tag, kind, 1, value)
        for tag, (kind, value) in fields.items()
    )
    mark = {"<": b"II", ">": b"MM"}[order]
    head = mark + struct.pack(order + "HIH", 42, 8, len(fields))
    return head + entries + struct.pack(order + "I", following)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", [1, 3, 4])
def test_the_size_of_a_tiff_in_each_integer_type(tmp_path: Path, order: str, kind: int) -> None:
    path = tmp_path / "a.tif"
    size = {256: (kind, 7), 257: (kind, 5)}
    path.write_bytes(directory(order, size))
    assert tiff_claim(path) == (5, 7)
    path.write_bytes(directory(order, {**size, 277: (3, 1)}))
    assert tiff_claim(path) == (5, 7)
    path.write_bytes(directory(order, {**size, 277: (3, 3)}))
    assert tiff_claim(path) == (5, 7, 3)
    path.write_bytes(directory(order, size, following=8))
    with pytest.raises(DepthFileError, match="several images in one TIFF"):
        tiff_claim(path)
    for tag in (256, 257):
        path.write_bytes(directory(order, {tag: (kind, 7)}))
        with pytest.raises(DepthFileError, match="a TIFF with a size"):
            tiff_claim(path)


@pytest.mark.parametrize("order", ["<", ">"])
def test_the_size_of_a_bigtiff_in_64_bit_fields(tmp_path: Path, order: str) -> None:
    mark = {"<": b"II", ">": b"MM"}[order]
    head = struct.pack(order + "HHHQQ", 43, 8, 0, 16, 2)
    size = b"".join(struct.pack(order + "HHQQ", tag, 16, 1, n) for tag, n in ((256, 7), (257, 5)))
    path = tmp_path / "a.tif"
    path.write_bytes(mark + head + size + bytes(8))
    assert tiff_claim(path) == (5, 7)


def test_a_tiff_of_another_number_or_order(tmp_path: Path) -> None:
    whole = directory("<", {256: (4, 7), 257: (4, 5)})
    path = tmp_path / "a.tif"
    for changed in (b"XX" + whole[2:], whole[:2] + b"\x29\0" + whole[4:], whole[:-9], b""):
        path.write_bytes(changed)
        with pytest.raises(DepthFileError, match="a TIFF of one channel"):
            tiff_claim(path)


def test_a_suffix_may_be_in_capitals_and_the_first_of_several_is_first(tmp_path: Path) -> None:
    assert files_named(tmp_path / "a.b") == []
    for name in ("a.b.TIF", "a.b.npy", "a.b.PFM", "a.b.txt", "a.npz"):
        (tmp_path / name).write_bytes(b"")
    found = [path.name for path in files_named(tmp_path / "a.b")]
    assert found == ["a.b.npy", "a.b.PFM", "a.b.TIF"]
    (tmp_path / "a.b.NPY").write_bytes(b"")
    assert files_named(tmp_path / "a.b")[0].name == "a.b.npy"


def exr(path: Path, channels: dict[str, Any]) -> Path:
    openexr = pytest.importorskip("OpenEXR", reason="OpenEXR is not installed")
    openexr.File({"type": openexr.scanlineimage}, dict(channels)).write(str(path))
    return path


@pytest.mark.parametrize(
    ("names", "depth"),
    [
        (["Z"], "Z"),
        (["z"], "z"),
        (["left.Z", "A"], "left.Z"),
        (["Z", "Y"], "Z"),
        (["Y", "A"], "Y"),
        (["V", "A"], "V"),
        (["anything"], "anything"),
        (["Z", "left.Z"], None),
        (["A", "B"], None),
    ],
)
def test_the_depth_channel_of_an_exr(tmp_path: Path, names: list[str], depth: str | None) -> None:
    arrays = {name: DEPTH + place for place, name in enumerate(names)}
    path = exr(tmp_path / "a.exr", arrays)
    if depth is None:
        with pytest.raises(DepthFileError, match="no single depth channel"):
            read_picture(path)
    else:
        values, name = read_picture(path)
        assert name == depth
        assert np.array_equal(values, arrays[depth])
    for each, values in arrays.items():
        found, said = read_picture(path, channel=each)
        assert said == each
        assert np.array_equal(found, values)
    with pytest.raises(DepthFileError, match="expected: channel nothing;"):
        read_picture(path, channel="nothing")


def test_three_equal_colours_of_an_exr_are_one_grey(tmp_path: Path) -> None:
    grey = DEPTH.copy()
    grey[0, 0] = np.nan
    values, name = read_picture(exr(tmp_path / "a.exr", {c: grey.copy() for c in "RGB"}))
    assert name == "R"
    assert np.array_equal(values, grey, equal_nan=True)
    for different in ({"R": grey, "G": grey, "B": DEPTH + 1}, {"R": grey, "G": grey.copy()}):
        with pytest.raises(DepthFileError, match="no single depth channel"):
            read_picture(exr(tmp_path / "b.exr", different))


def test_the_numbers_an_exr_may_hold(tmp_path: Path) -> None:
    half, _ = read_picture(exr(tmp_path / "a.exr", {"Z": DEPTH.astype(np.float16)}))
    assert np.array_equal(half, DEPTH.astype(np.float16))
    with pytest.raises(DepthFileError, match="found: Z uint32; expected: one channel Z"):
        read_picture(exr(tmp_path / "b.exr", {"Z": np.ones((5, 7), np.uint32)}))


def test_where_a_number_is_a_depth() -> None:
    values = np.array([1e150, 1.01e150, 1e-150, 0.99e-150, 0, -1, np.inf, -np.inf, np.nan])
    assert in_range(values, signed=False).tolist() == [True, False, True] + [False] * 6
    signed = in_range(np.concatenate([values, [-1e150, -1.01e150]]), signed=True)
    assert signed.tolist() == [True, False, True, True, True, True, *[False] * 3, True, False]
    single = np.array([np.finfo(np.float32).max, np.finfo(np.float32).tiny, 0, -1], np.float32)
    assert in_range(single, signed=False).tolist() == [True, True, False, False]
    array = DepthArray(values=values[None], space="disparity", unit=None, intrinsics_px=None)
    assert np.array_equal(array.prediction_mask(values), in_range(values, signed=True))


@pytest.mark.parametrize(
    ("unit", "count"),
    [("m", 1), ("mm", 1000), ("m/1", 1), ("m/256", 256), ("m/0.5", 0.5), ("m/0", None),
     ("m/-2", None), ("m/x", None), ("m/", None), ("m/inf", None), ("m/nan", None), ("cm", None),
     ("", None), (None, None), ("5000", None)],
)  # fmt: skip
def test_how_many_of_a_unit_make_a_metre(unit: str | None, count: float | None) -> None:
    assert per_metre(unit) == count
    if unit is not None:
        assert is_unit(unit) is (count is not None)
        assert is_unit("sun_rgbd")
        assert is_unit("nyu_raw")


def test_whole_metres_must_be_said_to_be_so() -> None:
    stored = np.array([[0, 3]], np.uint16)
    assert metres(stored, "m/1", invalid_value=None, source="a").tolist() == [[0.0, 3.0]]
    with pytest.raises(DepthFileError, match="found: unit 'm'"):
        metres(stored, "m", invalid_value=None, source="a")
    assert metres(stored, "m/1", invalid_value=3, source="a").tolist() == [[0.0, np.inf]]
    for wrong in (stored.astype(np.int16), stored[0]):
        with pytest.raises(DepthFileError, match="not a 16-bit depth image"):
            metres(wrong, "mm", invalid_value=None, source="a")


@pytest.mark.parametrize(
    ("line", "fits"),
    [("invalid_value = 0", True), ("invalid_value = 65535", True), ("invalid_value = 65536", False),
     ("invalid_value = -1", False), ("invalid_value = true", False), ("focal_px = 3", True),
     ("focal_px = -0.5", True), ("focal_px = 'a'", False), ("array = 'z'", True),
     ("array = 1", False), ("intrinsics_px = [1, 2, 3, 4, 5]", False),
     ("intrinsics_px = [1, 2, 3, nan]", False), ("intrinsics_px = 3", False)],
)  # fmt: skip
def test_what_a_declaration_may_say(tmp_path: Path, line: str, fits: bool) -> None:
    (tmp_path / "depth.toml").write_text(line + "\n")
    if fits:
        key, _, value = line.partition(" = ")
        declared = read_declaration(tmp_path)
        assert str(getattr(declared, key)) == value.strip("'")
    else:
        with pytest.raises(DepthTruthError, match="has an unknown key or value; found: "):
            read_declaration(tmp_path)


def test_a_declaration_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / DECLARATION
    assert declare(path, vars(Declaration()), {"space": None, "unit": None}) is None
    assert not path.exists()
    for declared in (Declaration(space="disparity"), IN_METRES):
        path.unlink(missing_ok=True)
        declare(path, vars(Declaration()), {"space": declared.space, "unit": declared.unit})
        assert read_declaration(tmp_path) == declared
