"""What was sent is unpacked within limits, or refused; nothing is written outside of its folder."""

from __future__ import annotations

import contextlib
import gzip
import io
import struct
import tarfile
import zipfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from legoworld.bench.archive import ArchiveError, UnpackLimits, unpack

LIMITS = UnpackLimits(unpacked_bytes=1 << 20, files=8)
FILES = {"scene.blend": b"BLENDER-v500", "scene.glb": b"glTF", "textures/wood.png": b"PNG"}


def tar_of(files, *, prefix="", **attributes) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        for name, data in files.items():
            info = tarfile.TarInfo(prefix + name)
            info.size = len(data)
            for key, value in attributes.items():
                setattr(info, key, value)
            archive.addfile(info, io.BytesIO(data))
    return stream.getvalue()


def zip_of(files, *, prefix="", method=zipfile.ZIP_DEFLATED, mode=0o100644) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, data in files.items():
            info = zipfile.ZipInfo(prefix + name)
            info.external_attr, info.compress_type = mode << 16, method
            archive.writestr(info, data)
    return stream.getvalue()


def unpack_upload(data: bytes, folder: Path, limits: UnpackLimits = LIMITS) -> tuple[Path, bool]:
    upload = folder / "upload"
    upload.write_bytes(data)
    return unpack(upload, "den__easy", limits)


@pytest.mark.parametrize("make", [tar_of, zip_of])
@pytest.mark.parametrize("prefix", ["", "./", "mine/", "./mine/"])
def test_a_scene_s_files_or_one_folder_with_them(make, prefix, tmp_path):
    data = make(FILES, prefix=prefix)
    for _ in range(2):  # a killed worker's order is unpacked again
        place, lone = unpack_upload(data, tmp_path)
        assert (place.name, lone) == ("den__easy", False)
        found = {str(p.relative_to(place)): p.read_bytes() for p in place.rglob("*.*")}
        assert found == FILES


@pytest.mark.parametrize("head", [b"BLENDER-v500", b"\x28\xb5\x2f\xfd"])
def test_a_blend_alone(head, tmp_path):
    place, lone = unpack_upload(head + b"rest", tmp_path)
    assert lone
    assert (place / "scene.blend").read_bytes() == head + b"rest"


ZEROS = {"scene.blend": bytes(1 << 24)}
MANY = {f"{n}": b"" for n in range(9)}
LINK = {"type": tarfile.SYMTYPE, "linkname": "/etc/passwd"}
HARD = {"type": tarfile.LNKTYPE, "linkname": "scene.blend"}
LONG = {"pax_headers": {"comment": "x" * (1 << 19)}}
BAD = {
    "a zip bomb": zip_of(ZEROS),
    "a tar beyond the limit": tar_of({"scene.blend": bytes((1 << 20) + 1)}),
    "a zip whose entry says less than it holds": zip_of(ZEROS).replace(
        struct.pack("<I", 1 << 24), struct.pack("<I", 9)
    ),
    "many entries": tar_of(MANY),
    "many entries of a zip": zip_of(MANY),
    "a link": tar_of({"scene.blend": b""}, **LINK),
    "a hard link": tar_of({"other": b""}, **HARD),
    "a FIFO": tar_of({"scene.blend": b""}, type=tarfile.FIFOTYPE),
    "a device": tar_of({"scene.blend": b""}, type=tarfile.CHRTYPE),
    "a link of a zip": zip_of({"scene.blend": b"/etc/passwd"}, mode=0o120777),
    "a long header": tar_of({"scene.blend": b""}, **LONG),
    "a long directory": zip_of({f"{n:>060}": b"" for n in range(3000)}),
    "a name outside": tar_of({"../scene.blend": b""}),
    "a name outside of a zip": zip_of({"a/../../scene.blend": b""}),
    "an absolute name": tar_of({"/scene.blend": b""}),
    "another system's name": zip_of({"a\\..\\scene.blend": b""}),
    "a long name": tar_of({"x" * 201: b""}),
    "a deep name": tar_of({"x/" * 9 + "x": b""}),
    "a name that is not printable": zip_of({"a\x1b[2J": b""}),
    "a name twice": tar_of({"./a": b"", "a": b""}),
    "a file as a folder": tar_of({"a": b"", "a/b": b""}),
    "bzip2": zip_of(FILES, method=zipfile.ZIP_BZIP2),
    "LZMA": zip_of(FILES, method=zipfile.ZIP_LZMA),
    "gzip": b"\x1f\x8b" + bytes(600),
    "half a tar": tar_of({"scene.blend": bytes(9000)})[:5000],
    "a tar that ends in a header": tar_of({"final.png": b"", "scene.blend": b"x"})[:600],
    "a tar with a damaged header": tar_of({"a": b"", "scene.blend": b"x"}).replace(
        b"scene.blend", b"scene_blend"
    ),
    "half a zip": zip_of(FILES)[:-30],
    "nothing": b"",
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(600),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_not_unpacked_says_why(name, tmp_path):
    with pytest.raises(ArchiveError) as caught:
        unpack_upload(BAD[name], tmp_path)
    assert caught.value.found
    assert [p for p in tmp_path.rglob("*") if p.is_symlink()] == []
    assert sum(p.stat().st_size for p in tmp_path.glob("unpacked*/**/*") if p.is_file()) <= 1 << 20


def test_a_compressed_tar_that_claims_to_be_plain_is_refused(tmp_path):
    packed = gzip.compress(tar_of(FILES))
    name = b"a" * (257 - 10) + b"ustar" + b"a" * 300 + b"\0"
    data = packed[:3] + b"\x08" + packed[4:10] + name + packed[10:]
    assert gzip.decompress(data) == tar_of(FILES)
    assert data[257:262] == b"ustar"
    with pytest.raises(ArchiveError):
        unpack_upload(data, tmp_path)


def test_a_tar_without_its_last_blocks_is_whole(tmp_path):
    folder, _ = unpack_upload(tar_of({"scene.blend": bytes(512)})[:1024], tmp_path)
    assert (folder / "scene.blend").read_bytes() == bytes(512)


def test_an_encrypted_zip_is_refused(tmp_path):
    data = bytearray(zip_of({"scene.blend": b"x"}))
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(mark) + offset] |= 1
    with pytest.raises(ArchiveError, match="encrypted"):
        unpack_upload(bytes(data), tmp_path)


def test_unpacking_ends_with_its_time(tmp_path):
    with pytest.raises(ArchiveError, match="more time"):
        unpack_upload(zip_of(FILES), tmp_path, UnpackLimits(unpacked_bytes=99, time_s=-1.0))


@given(
    data=st.sampled_from([tar_of(FILES), zip_of(FILES), tar_of(FILES, pax_headers={"a": "b"})]),
    changes=st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=8)), max_size=4),
    cut=st.floats(0.2, 1),
)
def test_damaged_archives_unpack_or_are_refused(data, changes, cut, tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    damaged = bytearray(data[: int(cut * len(data)) + 1])
    for place, replacement in changes:
        at = int(place * len(damaged))
        damaged[at : at + len(replacement)] = replacement
    with contextlib.suppress(ArchiveError):
        unpack_upload(bytes(damaged), folder)
    assert {p.name.partition("-")[0] for p in folder.iterdir()} == {"upload", "unpacked"}
