"""The cut-outs a snapshot makes of alpha textures: PNG and WebP; JPEG has no alpha."""

from __future__ import annotations

import math
import struct
import zlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import ALPHA_THRESHOLD
from legoworld.scene.gltf.buffers import Buffers, image_bytes
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.materials import TextureAlpha
from legoworld.scene.gltf.verdicts import Budget
from legoworld.scene.pictures import JPEG, PNG, claimed_size_wh, png_chunks
from legoworld.scene.snapshot import Cutout, Wrap

LARGEST_SIDE_PX: Final = 16384

_MOST_PX: Final = 1 << 26

_PICTURE_CHUNKS: Final = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")


def read_alpha(data: bytes) -> tuple[NDArray[np.uint8] | None, str]:
    """(H, W) uint8 alpha, top row first, None if all 1; and the reason if it is unknown.

    The reason is empty if the alpha is known. `size_wh` gives what decoding will allocate.
    """
    if data[:3] == JPEG:
        return None, ""
    width, height = size_wh(data)
    if width == 0:
        return None, f"is neither PNG, WebP nor JPEG of at most {LARGEST_SIDE_PX} pixels a side"
    plain = _plain_png(data) if data[:8] == PNG else data
    if plain is None:
        return None, "does not decode"
    import cv2

    try:
        picture: Any = cv2.imdecode(np.frombuffer(plain, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        picture = None
    if picture is None or picture.shape[:2] != (height, width):
        return None, "does not decode"
    if picture.ndim < 3 or picture.shape[2] < 4:
        return None, ""
    alpha = picture[..., 3]
    if alpha.dtype == np.uint16:
        alpha = np.rint(alpha / 257.0)
    return np.ascontiguousarray(alpha.astype(np.uint8)), ""


def size_wh(data: bytes) -> tuple[int, int]:
    """Width and height by a PNG's or WebP's header, read before anything is allocated.

    (0, 0) for anything else and for pictures beyond `LARGEST_SIDE_PX` or 2^26 pixels.
    """
    size = claimed_size_wh(data) if data[:4] in (PNG[:4], b"RIFF") else (0, 0)
    sound = all(0 < side <= LARGEST_SIDE_PX for side in size) and size[0] * size[1] <= _MOST_PX
    return size if sound else (0, 0)


def _plain_png(data: bytes) -> bytes | None:
    """The PNG reduced to its image chunks; None if a chunk is truncated or damaged."""
    kept = [PNG]
    for kind, start, end in png_chunks(data):
        (checksum,) = struct.unpack_from(">I", data, end - 4)
        if zlib.crc32(data[start + 4 : end - 4]) != checksum:
            return None
        if kind in _PICTURE_CHUNKS:
            kept.append(data[start:end])
        if kind == b"IEND":
            return b"".join(kept)
    return None


PictureCut = tuple[int, NDArray[np.float32]]
"""Index of a cut-out, and (T, 3, 2) float32 texture coordinates with v upwards."""


class Pictures:
    """The document's pictures as alpha, each decoded once, and the cut-outs made of them."""

    def __init__(self, document: Fields, buffers: Buffers, budget: Budget) -> None:
        self.cutouts: list[Cutout] = []
        self.alphas: list[NDArray[np.uint8]] = []
        self.warnings: set[str] = set()
        self._images = document.children("images")
        self._buffers = buffers
        self._budget = budget
        self._decoded: dict[int, NDArray[np.uint8] | None] = {}
        self._cutout_numbers: dict[tuple[Any, ...], int] = {}

    def plain(self) -> int:
        """The cut-out of one opaque texel: alpha comes from the corners alone."""
        if ("plain",) not in self._cutout_numbers:
            self._cutout_numbers[("plain",)] = len(self.cutouts)
            self.cutouts.append(Cutout(name="", wrap="extend", interpolation="closest"))
            self.alphas.append(np.full((1, 1), 255, np.uint8))
        return self._cutout_numbers[("plain",)]

    def cut(
        self, rule: TextureAlpha, uv: NDArray[np.float32], material: str, *, enough: float
    ) -> PictureCut | None:
        """The cut-out of triangles with glTF texture coordinates uv (T, 3, 2); None if opaque.

        enough: the image alpha, in [0, 1], from which nothing is cut.
        """
        alpha = self._alpha(rule.image, material)
        if alpha is None or (alpha >= enough * 255).all():
            return None
        uv_up = _transform_uv(uv, rule)
        tiling = _find_tiling(rule, uv_up, alpha.shape)
        if tiling is None:
            self.warnings.add(
                f"material {material!r}: its alpha texture wraps differently in u and v over a "
                f"long way; {rule.wrap_s} was taken for both"
            )
            tiling = (rule.wrap_s, 0, 1, 0, 1)
        wrap, left, across, low, up = tiling
        key = (rule.image, rule.cutoff, rule.interpolation, rule.wrap_s, rule.wrap_t, *tiling)
        if key not in self._cutout_numbers:
            self._budget.take(2 * alpha.nbytes * across * up, "alpha textures")
            tiled = _tile_picture(alpha, rule, left, across, low, up)
            self._cutout_numbers[key] = len(self.cutouts)
            name = self._images[rule.image].text("name") or f"image {rule.image}"
            self.cutouts.append(Cutout(name=name, wrap=wrap, interpolation=rule.interpolation))
            self.alphas.append(threshold_at_half(tiled, rule.cutoff))
        return self._cutout_numbers[key], ((uv_up - (left, low)) / (across, up)).astype(np.float32)

    def _alpha(self, image: int, material: str) -> NDArray[np.uint8] | None:
        """(H, W) uint8 alpha, top row first; None where it is 1 or unknown."""
        if image not in self._decoded:
            self._decoded[image] = self._decode(image, material)
        return self._decoded[image]

    def _decode(self, number: int, material: str) -> NDArray[np.uint8] | None:
        data = image_bytes(self._images[number], self._buffers) if number >= 0 else None
        why = "is missing"
        if data is not None:
            width, height = size_wh(data)
            self._budget.take(width * height, "alpha textures")
            alpha, why = read_alpha(data)
            if not why:
                return alpha
        self.warnings.add(
            f"material {material!r}: its alpha texture {why}; its surface is taken as opaque"
        )
        return None


def threshold_at_half(alpha: NDArray[np.uint8], cutoff: float) -> NDArray[np.uint8]:
    """(H, W) uint8 alpha moved so that >= cutoff becomes >= `ALPHA_THRESHOLD`.

    The map is affine and stays within [0, 255], so that interpolation between texels meets the
    threshold in the same place, up to a step of the coarser 8 bits; texels themselves are exact.
    """
    if cutoff == ALPHA_THRESHOLD:
        return alpha
    slope = min(ALPHA_THRESHOLD / cutoff, ALPHA_THRESHOLD / max(1 - cutoff, 1e-9), 1.0)
    levels = np.arange(256) / 255
    moved = np.floor((ALPHA_THRESHOLD + slope * (levels - cutoff)) * 255 + 0.5).astype(np.int64)
    there = levels >= cutoff
    table = np.where(there, np.maximum(moved, 128), np.minimum(moved, 127))
    return np.clip(table, 0, 255).astype(np.uint8)[alpha]


def _transform_uv(uv: NDArray[np.float32], rule: TextureAlpha) -> NDArray[np.float64]:
    """Texture coordinates after KHR_texture_transform, with v upwards."""
    a, b, c, d, e, f = rule.uv_from_uv
    u, v = uv[..., 0].astype(np.float64), uv[..., 1].astype(np.float64)
    return np.stack([a * u + b * v + c, 1.0 - (d * u + e * v + f)], axis=-1)


_Tiling = tuple[Wrap, int, int, int, int]


def _find_tiling(
    rule: TextureAlpha, uv: NDArray[np.float64], shape: tuple[int, ...]
) -> _Tiling | None:
    """One wrap rule for both directions: wrap, first column of tiles, columns, first row, rows.

    Where the file has two, the picture is repeated as far as the triangles reach (and one tile
    further, for interpolation) and the result is extended; None where that is too large.
    """
    if rule.wrap_s == rule.wrap_t:
        return rule.wrap_s, 0, 1, 0, 1
    spans = []
    for axis, wrap in enumerate((rule.wrap_s, rule.wrap_t)):
        first, count = 0, 1
        if wrap != "extend":
            low, high = float(uv[..., axis].min()), float(uv[..., axis].max())
            if not (abs(low) < 1e4 and abs(high) < 1e4):
                return None
            first = math.floor(low) - 1
            count = math.ceil(high) + 1 - first
        if count * shape[1 - axis] > LARGEST_SIDE_PX:
            return None
        spans += [first, count]
    return "extend", spans[0], spans[1], spans[2], spans[3]


def _tile_picture(
    alpha: NDArray[np.uint8], rule: TextureAlpha, left: int, across: int, low: int, up: int
) -> NDArray[np.uint8]:
    """The picture repeated or mirrored from tile (left, low) on; v upwards, rows from the top."""

    def tile(column: int, row: int) -> NDArray[np.uint8]:
        shown = alpha[:, ::-1] if rule.wrap_s == "mirror" and column % 2 else alpha
        return shown[::-1] if rule.wrap_t == "mirror" and row % 2 else shown

    if (across, up) == (1, 1):
        return alpha
    rows = [
        np.hstack([tile(column, row) for column in range(left, left + across)])
        for row in reversed(range(low, low + up))
    ]
    return np.ascontiguousarray(np.vstack(rows))
