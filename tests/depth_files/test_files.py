"""Every accepted depth format read exactly, and every wrong file refused with its reason."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.read_depth import read_pfm, read_picture, read_raw_float32
from legoworld.evaluation.depth.arrays import Declaration, DepthTruthError, read_declaration
from legoworld.evaluation.depth.labelled import metres, read_labelled
from legoworld.evaluation.depth.truth import planar_metres

DEPTH = np.random.default_rng(0).uniform(0.5, 60, (5, 7)).astype(np.float32)
DEPTH[1, 2] = np.inf
JPEG = b"\xff\xd8\xff\xe0" + b"\0" * 136
IN_METRES = Declaration(space="depth", unit="m")
Arrays = dict[str, Any]


def npz(path: Path, **arrays: Any) -> Path:
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize(("order", "scale"), [("<", b"-1.0"), (">", b"1"), ("<", b"-0.003")])
def test_pfm_of_both_byte_orders_starts_at_the_top(
    tmp_path: Path, order: str, scale: bytes
) -> None:
    path = tmp_path / "a.pfm"
    pixels = DEPTH[::-1].astype(order + "f4").tobytes()  # rows from the bottom, as PFM has them
    path.write_bytes(b"Pf\n7 5\n" + scale + b"\n" + pixels)
    found = read_pfm(path)
    assert np.array_equal(found, DEPTH)
    assert found.dtype == np.dtype("=f4")


@pytest.mark.parametrize(
    "header", [b"PF\n7 5\n-1\n", b"Pf\n7\n-1\n", b"Pf\n7 5\n0\n", b"Pf\n7 6\n-1\n", b"P5\n7 5\n1\n"]
)
def test_pfm_that_is_not_one_channel_of_its_size(tmp_path: Path, header: bytes) -> None:
    path = tmp_path / "a.pfm"
    path.write_bytes(header + DEPTH.tobytes())
    with pytest.raises(DepthFileError, match=r"PFM|pixels"):
        read_pfm(path)


def test_npy_and_raw(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", DEPTH.astype(">f4"))
    assert np.array_equal(read_labelled(tmp_path / "a.npy", IN_METRES).values, DEPTH)
    DEPTH.astype("<f4").tofile(tmp_path / "a.JPG")
    assert np.array_equal(read_raw_float32(tmp_path / "a.JPG", (7, 5)), DEPTH)


def big_endian_tiff(path: Path, values: Any) -> None:
    """A one-strip TIFF as its standard has it, in the byte order that is not this machine's."""
    height, width = values.shape
    entries = [
        (256, 3, width),
        (257, 3, height),
        (258, 3, 16),
        (259, 3, 1),
        (262, 3, 1),
        (273, 4, 8),
        (277, 3, 1),
        (278, 3, height),
        (279, 4, 2 * width * height),
    ]
    pixels = values.astype(">u2").tobytes()
    directory = struct.pack(">H", len(entries)) + b"".join(
        struct.pack(">HHIHH", tag, kind, 1, value, 0)
        if kind == 3
        else struct.pack(">HHII", tag, kind, 1, value)
        for tag, kind, value in entries
    )
    head = struct.pack(">2sHI", b"MM", 42, 8 + len(pixels))
    path.write_bytes(head + pixels + directory + struct.pack(">I", 0))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("suffix", [".npy", ".npz", ".png", ".tiff"])
def test_integers_of_both_byte_orders(tmp_path: Path, suffix: str, order: str) -> None:
    stored = np.array([[0, 1, 255], [256, 1000, 65534]], np.uint16)
    path = tmp_path / f"a{suffix}"
    if suffix == ".npy":
        np.save(path, stored.astype(f"{order}u2"))
    elif suffix == ".npz":
        np.savez(path, values=stored.astype(f"{order}u2"))
    elif suffix == ".tiff" and order == ">":
        big_endian_tiff(path, stored)
    else:
        cv2.imwrite(str(path), stored)
    found = read_labelled(path, Declaration(space="depth", unit="mm")).values
    assert np.array_equal(found, stored / 1000.0)
    assert found.dtype.isnative


@pytest.mark.parametrize("kind", [">f2", ">f4", ">f8", "<f2", "<f8"])
def test_floats_of_both_byte_orders(tmp_path: Path, kind: str) -> None:
    np.save(tmp_path / "a.npy", DEPTH.astype(kind))
    array = read_labelled(tmp_path / "a.npy", IN_METRES, accept_float16=True)
    assert np.array_equal(array.values, DEPTH.astype(kind).astype(np.float64))
    assert array.values.dtype.isnative
    assert array.stored is not None
    assert array.stored.dtype == str(np.dtype(kind))  # as the file has it


def test_raw_of_another_size_names_both_numbers(tmp_path: Path) -> None:
    DEPTH.tofile(tmp_path / "a.JPG")
    with pytest.raises(DepthFileError, match=r"140 bytes.*168 bytes = 4 x 7 x 6"):
        read_raw_float32(tmp_path / "a.JPG", (7, 6))


@pytest.mark.parametrize("name", ["a.JPG", "a.npy", "a.npz", "a.pfm", "a.png", "a.exr"])
def test_a_photo_is_called_a_photo(tmp_path: Path, name: str) -> None:
    # A photo of exactly the raw depth's size, too.
    path = tmp_path / name
    path.write_bytes(JPEG)
    with pytest.raises(DepthFileError, match="is the photo, not the depth"):
        read_raw_float32(path, (7, 5)) if name == "a.JPG" else read_labelled(path, IN_METRES)


def test_a_readout_and_a_baseline(tmp_path: Path) -> None:
    own = read_labelled(npz(tmp_path / "a.npz", depth_z_m=DEPTH, space="depth"), Declaration())
    assert (own.space, own.unit, own.size_wh) == ("depth", "m", (7, 5))
    arrays: Arrays = {"values": DEPTH, "space": "disparity", "unit": ""}
    baseline = read_labelled(npz(tmp_path / "b.npz", **arrays), Declaration())
    assert (baseline.space, baseline.unit) == ("disparity", None)
    arrays = {"values": DEPTH, "space": "ray_distance", "intrinsics_px": np.array([9.0, 8, 3, 2])}
    rays = read_labelled(npz(tmp_path / "c.npz", **arrays), Declaration())
    assert rays.intrinsics_px == (9.0, 8.0, 3.0, 2.0)


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        ({"values": DEPTH}, "does not say what its numbers are"),
        ({"depth_z_m": DEPTH}, "does not say what its numbers are"),
        ({"depth_z_m": DEPTH, "space": "disparity"}, "contradictory declarations"),
        ({"depth_z_m": DEPTH, "space": "depth", "unit": "mm"}, "contradictory declarations"),
        ({"values": DEPTH, "space": "metric"}, "does not say what its numbers are"),
        ({"values": DEPTH, "space": np.array(["depth"])}, "space is no text"),
        ({"values": DEPTH, "depth_z_m": DEPTH, "space": "depth"}, "does not have one depth array"),
        ({"a": DEPTH, "b": DEPTH, "space": "depth"}, "does not have one depth array"),
        ({"space": "depth"}, "does not have one depth array"),
        ({"values": DEPTH.astype(np.float16), "space": "depth"}, "float16"),
        ({"values": DEPTH.astype(np.complex64), "space": "depth"}, "complex64"),
        ({"values": np.stack([DEPTH] * 2), "space": "depth"}, "not one depth image"),
        ({"values": DEPTH[0], "space": "depth"}, "not one depth image"),
        ({"values": DEPTH[:0], "space": "depth"}, "not one depth image"),
        ({"values": DEPTH, "space": "ray_distance"}, "no intrinsics"),
        (
            {"values": DEPTH, "space": "ray_distance", "intrinsics_px": np.array([0.0, 1, 2, 3])},
            "intrinsics that cannot be used",
        ),
        (
            {"values": DEPTH, "space": "ray_distance", "intrinsics_px": np.array([1.0, 1, 2])},
            "intrinsics_px cannot be used",
        ),
        ({"values": np.ones((2, 2), np.uint16), "space": "depth"}, "without a declared unit"),
        ({"values": np.ones((2, 2), np.int32), "space": "depth", "unit": "mm"}, "16-bit"),
        ({"values": np.array([{}]), "space": "depth"}, "cannot be read"),
    ],
)
def test_what_an_npz_must_not_be(tmp_path: Path, arrays: Arrays, says: str) -> None:
    with pytest.raises(DepthFileError, match=says):
        read_labelled(npz(tmp_path / "a.npz", **arrays), Declaration())


@pytest.mark.parametrize("content", [b"", b"PK\3\4 broken", b"text"])
@pytest.mark.parametrize("suffix", [".npz", ".npy", ".png", ".pfm"])
def test_damaged_files(tmp_path: Path, content: bytes, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(DepthFileError):
        read_labelled(path, IN_METRES)


def test_a_cut_npz_is_damaged_not_short(tmp_path: Path) -> None:
    whole = npz(tmp_path / "a.npz", depth_z_m=DEPTH, space="depth").read_bytes()
    flipped = bytearray(whole)
    flipped[whole.index(DEPTH.tobytes()) + 9] ^= 1  # one bit of one pixel
    for bad in (whole[:-30], bytes(flipped)):
        (tmp_path / "b.npz").write_bytes(bad)
        with pytest.raises(DepthFileError, match="cannot be read"):
            read_labelled(tmp_path / "b.npz", Declaration())


def test_declared_labels_and_the_file_s_own_must_agree(tmp_path: Path) -> None:
    path = npz(tmp_path / "a.npz", z=DEPTH, values=DEPTH * 2)
    declared = Declaration(space="depth", unit="m", array="z")
    assert np.array_equal(read_labelled(path, declared).values, DEPTH)
    path = npz(tmp_path / "b.npz", values=DEPTH, space="disparity")
    with pytest.raises(DepthFileError, match="contradictory declarations"):
        read_labelled(path, IN_METRES)


def test_png_in_each_unit(tmp_path: Path) -> None:
    import cv2

    stored = np.array([[0, 1, 1000], [5000, 40000, 65534]], np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), stored)
    for unit, per_metre in (("mm", 1000), ("m/256", 256), ("m/5000", 5000)):
        array = read_labelled(tmp_path / "a.png", Declaration(space="depth", unit=unit))
        assert np.array_equal(array.values, stored / per_metre)
        assert array.unit == "m"
    turned = ((stored.astype(np.uint32) << 3) | (stored >> 13)).astype(np.uint16)
    assert np.array_equal(metres(turned, "sun_rgbd", invalid_value=None, source="a"), stored / 1000)
    raw = np.array([[400, 1092, 1093, 2047]], np.uint16)
    kinect = metres(raw.byteswap(), "nyu_raw", invalid_value=None, source="a")
    np.testing.assert_allclose(kinect[0, :2], [351.3 / 692.5, 702.6], rtol=1e-12)
    assert (kinect[0, 2:] < 0).all()


def test_png_that_cannot_be_depth(tmp_path: Path) -> None:
    import cv2

    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.full((4, 4), 200, np.uint8))
    with pytest.raises(DepthFileError, match=r"uint8.*viewing"):
        read_labelled(path, Declaration(space="depth", unit="mm"))
    cv2.imwrite(str(path), np.full((4, 4, 3), 200, np.uint16))
    with pytest.raises(DepthFileError, match="one channel"):
        read_labelled(path, Declaration(space="depth", unit="mm"))
    cv2.imwrite(str(path), np.full((4, 4), 200, np.uint16))
    with pytest.raises(DepthFileError, match="without a declared unit"):
        read_labelled(path, Declaration(space="depth"))
    with pytest.raises(DepthFileError, match="does not say what its numbers are"):
        read_labelled(path, Declaration(unit="mm"))


def test_millimetres_end_at_65_metres(tmp_path: Path) -> None:
    stored = np.array([[1000, 65535, 65535]], np.uint16)
    with pytest.raises(DepthFileError, match=r"clipped.*2 pixels of 65535"):
        metres(stored, "mm", invalid_value=None, source="a.png")
    unknown = metres(stored, "mm", invalid_value=65535, source="a.png")
    assert unknown.tolist() == [[1.0, np.inf, np.inf]]


def test_exr_channel_z(tmp_path: Path) -> None:
    openexr = pytest.importorskip("OpenEXR", reason="OpenEXR is not installed")
    kind = {"type": openexr.scanlineimage, "compression": openexr.ZIP_COMPRESSION}
    path = str(tmp_path / "a.exr")
    openexr.File(kind, {"Z": DEPTH}).write(path)
    assert np.array_equal(read_picture(tmp_path / "a.exr")[0], DEPTH)
    rgb = np.zeros((5, 7, 3), np.float32)
    openexr.File(kind, {"View.Z": DEPTH, "RGB": rgb}).write(path)
    assert np.array_equal(read_picture(tmp_path / "a.exr")[0], DEPTH)
    (tmp_path / "a.exr").write_bytes(b"no exr")
    with pytest.raises(DepthFileError, match="cannot be read"):
        read_picture(tmp_path / "a.exr")


def test_exr_without_its_package_says_what_to_install(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    (tmp_path / "a.exr").write_bytes(b"v/1\x01 whatever")
    with pytest.raises(DepthFileError, match=r"pip install 'OpenEXR>=3\.3'"):
        read_picture(tmp_path / "a.exr")


def test_truth_of_every_space_becomes_planar_metres(tmp_path: Path) -> None:
    z = np.random.default_rng(1).uniform(1, 9, (150, 40))
    rows, cols = np.mgrid[:150, :40]
    x, y = (cols + 0.5 - 19) / 50, (rows + 0.5 - 80) / 45
    rays = z * np.sqrt(x**2 + y**2 + 1)
    arrays: Arrays = {"values": rays * 1000, "space": "ray_distance", "unit": "mm"}
    path = npz(tmp_path / "a.npz", **arrays, intrinsics_px=np.array([50.0, 45, 19, 80]))
    array = read_labelled(path, Declaration())
    np.testing.assert_allclose(planar_metres(array, Declaration(), "a"), z, rtol=1e-14)
    # As a prediction, the same array must give the same disparity.
    disparity, predicted = array.at(rows.ravel(), cols.ravel())
    assert predicted.all()
    np.testing.assert_allclose(disparity * 1000, 1 / z.ravel(), rtol=1e-13)

    stereo = Declaration(space="disparity", unit="px", focal_px=900, baseline_m=0.2, doffs_px=30)
    pixels = 180 / z - 30
    pixels[0, :4] = [np.inf, -np.inf, np.nan, -40]
    np.save(tmp_path / "b.npy", pixels)
    found = planar_metres(read_labelled(tmp_path / "b.npy", stereo), stereo, "b")
    assert found[0, :2].tolist() == [np.inf, np.inf]
    assert np.isnan(found[0, 2])
    assert found[0, 3] == np.inf
    np.testing.assert_allclose(found.ravel()[4:], z.ravel()[4:], rtol=1e-13)
    np.save(tmp_path / "b.npy", np.array([[0.5 - 30, 0.0 - 30]]))  # far, and at infinity
    found = planar_metres(read_labelled(tmp_path / "b.npy", stereo), stereo, "b")
    assert found.tolist() == [[360.0, np.inf]]


@pytest.mark.parametrize(
    "declared",
    [{"space": "depth"}, {"space": "depth", "unit": "px"}, {"space": "disparity", "unit": "px"}],
)
def test_a_truth_without_a_unit_is_refused(tmp_path: Path, declared: dict[str, str]) -> None:
    np.save(tmp_path / "a.npy", DEPTH)
    declaration = Declaration(**declared)  # type: ignore[arg-type]
    with pytest.raises(DepthTruthError, match="without"):
        planar_metres(read_labelled(tmp_path / "a.npy", declaration), declaration, "a.npy")


def test_depth_toml(tmp_path: Path) -> None:
    assert read_declaration(tmp_path) == Declaration()
    (tmp_path / "depth.toml").write_text(
        'space = "ray_distance"\nunit = "mm"\nintrinsics_px = [525, 525.0, 320, 240]\n'
    )
    assert read_declaration(tmp_path) == Declaration(
        space="ray_distance", unit="mm", intrinsics_px=(525.0, 525.0, 320.0, 240.0)
    )


@pytest.mark.parametrize(
    "text",
    [
        'space = "z"',
        'units = "mm"',
        "unit = 3",
        "intrinsics_px = [1, 2, 3]",
        "space = ",
        "invalid_value = 1.5",
        "focal_px = true",
    ],
)
def test_depth_toml_with_a_mistake(tmp_path: Path, text: str) -> None:
    (tmp_path / "depth.toml").write_text(text)
    with pytest.raises(DepthTruthError, match=r"depth\.toml"):
        read_declaration(tmp_path)
