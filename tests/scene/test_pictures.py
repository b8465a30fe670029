"""Picture files of strangers: the size is read first, and what is too large is not decoded."""

from __future__ import annotations

import io
import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from legoworld.errors import SceneInvalidError
from legoworld.readouts.pictures import read_photo
from legoworld.report.photos import page_picture
from legoworld.scene import pictures
from legoworld.scene.artefacts import check_picture
from legoworld.scene.pictures import (
    MOST_PHOTO_PX,
    MOST_PX,
    PictureTooLargeError,
    claimed_size_wh,
    decoded_picture,
)

PICTURE = np.random.default_rng(0).integers(0, 256, (6, 9, 3)).astype(np.uint8)


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(
        ">I", zlib.crc32(kind + content)
    )  # fmt: skip


def bomb(width: int, height: int) -> bytes:
    """A sound PNG of one colour, a thousandth of its pixels in bytes."""
    pack = zlib.compressobj(9)
    row = bytes(1 + width)
    rows = b"".join(pack.compress(row) for _ in range(height)) + pack.flush()
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return pictures.PNG + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp", ".bmp", ".tiff", ".ppm"])
def test_the_header_says_what_is_decoded(suffix):
    data = cv2.imencode(suffix, PICTURE)[1].tobytes()
    assert claimed_size_wh(data) == (9, 6)
    assert decoded_picture(data).shape == (6, 9, 3)
    assert claimed_size_wh(data[:5]) == (0, 0)
    assert decoded_picture(data[:20]) is None


@pytest.mark.parametrize(
    ("suffix", "least"),
    [(".png", 33), (".webp", 30), (".bmp", 26), (".jpg", None), (".ppm", 7)],
)
def test_a_header_is_read_as_soon_as_it_is_whole(suffix, least):
    """Of every prefix: no size, or the right one; from the last byte that states it on."""
    data = cv2.imencode(suffix, PICTURE)[1].tobytes()
    if least is None:
        least = data.index(b"\xff\xc0") + 9
    assert [claimed_size_wh(data[:n]) for n in range(least)] == [(0, 0)] * least
    assert {claimed_size_wh(data[:n]) for n in range(least, len(data) + 1)} == {(9, 6)}


def test_headers_of_tiff_and_netpbm_in_other_byte_orders_and_with_comments():
    entries = struct.pack(">HHHIHHHHIHH", 2, 257, 3, 1, 6, 0, 256, 4, 1, 0, 9)
    assert claimed_size_wh(b"MM\0*" + struct.pack(">I", 8) + entries) == (9, 6)
    assert claimed_size_wh(b"P6\n# 3 4\n9# width\n 6\n255\n") == (9, 6)
    assert claimed_size_wh(b"P7\nWIDTH 9\n") == (0, 0)


def test_a_jpeg_with_other_segments_and_filling_before_its_frame():
    data = cv2.imencode(".jpg", PICTURE)[1].tobytes()
    comment = b"\xff\xfe" + struct.pack(">H", 12) + b"\xff\xc0\0\x0b\x08\0\1\0\1\0"
    odd = data[:2] + comment + b"\xff\xff" + data[2:][0:0] + b"\xff\xfe\0\2" + data[2:]
    assert claimed_size_wh(odd) == (9, 6), "a frame header inside a comment is none"
    assert np.array_equal(decoded_picture(odd), decoded_picture(data))


def test_what_claims_too_many_pixels_is_refused_before_it_is_decoded(tmp_path, monkeypatch):
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    data = bomb(8192, MOST_PX // 8192 + 1)
    path = tmp_path / "final.png"
    path.write_bytes(data)
    assert len(data) < 100_000
    with pytest.raises(SceneInvalidError, match=r"found: 8192x4097 pixels in [\d,]+ bytes"):
        check_picture(path)
    said = page_picture(path, "one/final.png", most_px=MOST_PX).note
    assert "8192x4097 pixels" in said
    assert str(tmp_path) not in said
    path.write_bytes(bomb(8192, MOST_PHOTO_PX // 8192 + 1))
    with pytest.raises(PictureTooLargeError, match=f"{path} is too large"):
        read_photo(path)


def test_a_png_whose_chunk_claims_more_than_the_file_is_none():
    data = cv2.imencode(".png", PICTURE)[1].tobytes()
    assert decoded_picture(data[:33] + struct.pack(">I4s", 1 << 30, b"tEXt") + data[33:]) is None
    assert decoded_picture(data[:-12]) is None


def test_a_photo_that_is_a_fifo_does_not_block(tmp_path):
    import os

    os.mkfifo(tmp_path / "photo.png")
    with pytest.raises(OSError, match="it is a FIFO"):
        read_photo(tmp_path / "photo.png")


@pytest.mark.parametrize("size_wh", [(5, 3), (700, 300), (16383, 1), (1, 16383)])
@pytest.mark.parametrize("kind", ["lossy", "lossless", "extended"])
def test_the_claimed_size_of_each_kind_of_webp(kind, size_wh):
    mode, more = ("RGBA", {}) if kind == "extended" else ("RGB", {"lossless": kind == "lossless"})
    stream = io.BytesIO()
    Image.new(mode, size_wh, 128).save(stream, "WEBP", quality=5, **more)
    data = stream.getvalue()
    assert data[12:16] == {"lossy": b"VP8 ", "lossless": b"VP8L", "extended": b"VP8X"}[kind]
    assert claimed_size_wh(data) == size_wh
    assert claimed_size_wh(data[:12] + b"NONE" + data[16:]) == (0, 0)
