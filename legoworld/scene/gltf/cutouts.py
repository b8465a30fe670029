"""The cut-outs a snapshot makes of alpha textures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import ALPHA_THRESHOLD
from legoworld.scene.gltf.buffers import Buffers, image_bytes
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.materials import TextureAlpha
from legoworld.scene.gltf.pictures import LARGEST_SIDE_PX, read_alpha, size_wh
from legoworld.scene.gltf.verdicts import Budget
from legoworld.scene.snapshot import Cutout, Wrap

PictureCut = tuple[int, NDArray[np.float32]]
"""Index of a cut-out, and (T, 3, 2) float32 texture coordinates with v upwards."""


@dataclass(frozen=True, kw_only=True)
class Cut:
    """Alpha within the triangles of a primitive.

    cutout: (T,) int32 index of a cut-out, -1 for none; uv: (T, 3, 2) float32, v upwards; alpha:
    (T, 3) float32 at the corners, None for 1.
    """

    cutout: NDArray[np.int32]
    uv: NDArray[np.float32]
    alpha: NDArray[np.float32] | None


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
        self._known: dict[tuple[Any, ...], int] = {}

    def plain(self) -> int:
        """The cut-out of one opaque texel: alpha comes from the corners alone."""
        if ("plain",) not in self._known:
            self._known[("plain",)] = len(self.cutouts)
            self.cutouts.append(Cutout(name="", wrap="extend", interpolation="closest"))
            self.alphas.append(np.full((1, 1), 255, np.uint8))
        return self._known[("plain",)]

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
        if key not in self._known:
            self._budget.take(2 * alpha.nbytes * across * up, "alpha textures")
            tiled = _tile_picture(alpha, rule, left, across, low, up)
            self._known[key] = len(self.cutouts)
            name = self._images[rule.image].text("name") or f"image {rule.image}"
            self.cutouts.append(Cutout(name=name, wrap=wrap, interpolation=rule.interpolation))
            self.alphas.append(threshold_at_half(tiled, rule.cutoff))
        return self._known[key], ((uv_up - (left, low)) / (across, up)).astype(np.float32)

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
