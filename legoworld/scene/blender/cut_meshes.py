"""Triangles under alpha rules: which remain, and the cut-outs of partly transparent ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import ALPHA_THRESHOLD
from legoworld.scene.blender.alpha_attributes import corner_values
from legoworld.scene.blender.alpha_table import AlphaTable, Cut, ImageFactor
from legoworld.scene.blender.alpha_values import Curve, ProductSource
from legoworld.scene.blender.materials import (
    AttributeAlpha,
    ImageAlpha,
    OneSided,
    SidedAlpha,
    find_cut,
    one_sided_rule,
)
from legoworld.scene.blender.meshes import Triangles, corner_uv, transform_uv
from legoworld.scene.blender.shader_links import UnreadableAlphaError
from legoworld.scene.snapshot import Sides
from legoworld.scene.triangle_cuts import TriangleCuts

if TYPE_CHECKING:
    import bpy


@dataclass(frozen=True, kw_only=True)
class _Piece:
    """Some of a mesh's triangles under one cut.

    place: (N,) index of each. cut: index into the table's cuts, -1 for none. uv: (N, 3, 2) and
    alpha: (N, 3), None for 0 and 1.
    """

    place: NDArray[np.int64]
    cut: int
    uv: NDArray[np.float32] | None = None
    alpha: NDArray[np.float32] | None = None


@dataclass(frozen=True, kw_only=True)
class MeshCutter:
    """Applies alpha rules to one mesh. evaluated_object: its object in the depsgraph.

    unread: grows by what was taken as opaque: a rule's number, and why.
    """

    mesh: bpy.types.Mesh
    evaluated_object: bpy.types.Object
    alphas: AlphaTable
    warnings: set[str]
    unread: set[tuple[int, str]]

    def cut(
        self, triangles: Triangles, rules: NDArray[np.int32]
    ) -> tuple[Triangles, TriangleCuts | None]:
        """The remaining triangles, and the rule of each, (T,) indices of the table.

        Order is kept. A triangle with a different rule on each side is listed twice.
        """
        pieces: list[_Piece] = []
        for number in np.unique(rules).tolist():
            place, varying = np.flatnonzero(rules == number), self.alphas.find_rule(number)
            if varying is None:
                pieces.append(_Piece(place=place, cut=-1))
                continue
            sides: list[tuple[OneSided, Sides]] = (
                [(varying.front, "front"), (varying.back, "back")]
                if isinstance(varying, SidedAlpha)
                else [(varying, "both")]
            )
            for rule, side in sides:
                try:
                    pieces += self._pieces(triangles, place, rule, side)
                except UnreadableAlphaError as error:
                    self.unread.add((number, str(error)))
                    pieces += self._pieces(triangles, place, "there", side)
        return _join_pieces(triangles, pieces)

    def _pieces(
        self, triangles: Triangles, place: NDArray[np.int64], rule: OneSided, sides: Sides
    ) -> list[_Piece]:
        if rule == "there":
            if sides == "both":
                return [_Piece(place=place, cut=-1)]
            return [_Piece(place=place, cut=self._number(None, sides))]
        if isinstance(rule, str):
            return []
        if isinstance(rule, ImageAlpha):
            uv = self._uv(triangles, place, rule)
            return [_Piece(place=place, cut=self._number(rule, sides), uv=uv)]
        chosen = Triangles(vertices=triangles.vertices[place], corners=triangles.corners[place])
        source = rule.source
        attribute = source.attribute if isinstance(source, ProductSource) else source
        values = corner_values(self.mesh, self.evaluated_object, attribute, chosen)
        low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
        if low == high:
            return self._pieces(triangles, place, _at_constant(rule, low), sides)
        if not isinstance(source, ProductSource):
            cut = find_cut(rule.of, low, high)
            if isinstance(cut, str):
                return self._pieces(triangles, place, cut, sides)
            there = values >= cut.at if cut.above else values <= cut.at
            alpha = ALPHA_THRESHOLD + (values - cut.at) * (1.0 if cut.above else -1.0)
            return self._by_corners(triangles, place, alpha, there, sides)
        return self._product(triangles, place, rule, source, values, sides)

    def _by_corners(
        self,
        triangles: Triangles,
        place: NDArray[np.int64],
        alpha: NDArray[np.float64],
        there: NDArray[np.bool_],
        sides: Sides,
    ) -> list[_Piece]:
        """Whole triangles, and those whose corners differ.

        alpha, there: (N, 3) at the corners, and whether that is enough.
        """
        whole, mixed = there.all(1), there.any(1) & ~there.all(1)
        pieces = self._pieces(triangles, place[whole], "there", sides)
        below = np.nextafter(np.float32(ALPHA_THRESHOLD), np.float32(0))
        exact = np.where(
            there, np.maximum(alpha, ALPHA_THRESHOLD), np.minimum(alpha, below)
        ).astype(np.float32)
        if mixed.any():
            number = self._number(None, sides)
            pieces.append(_Piece(place=place[mixed], cut=number, alpha=exact[mixed]))
        return pieces

    def _product(
        self,
        triangles: Triangles,
        place: NDArray[np.int64],
        rule: AttributeAlpha,
        source: ProductSource,
        values: NDArray[np.float64],
        sides: Sides,
    ) -> list[_Piece]:
        """An image times an attribute, brought to (share of the image) * corner >= threshold."""
        low, high = float(values.min()), float(values.max())
        if not source.everywhere and (low < 0.0 or high > 1.0):
            raise UnreadableAlphaError("alpha comes from an attribute beyond 0..1, cut off there")
        ends = [source.at(i, v) for i in (0.0, 1.0) for v in (low, high)]
        cut = find_cut(rule.of, min(ends), max(ends))
        if isinstance(cut, str):
            return self._pieces(triangles, place, cut, sides)
        a, b, c, d = source.coefficients
        if abs(d) < 1e-9:
            raise UnreadableAlphaError("alpha is a sum of its image and its attribute")
        sign = 1.0 if cut.above else -1.0
        # a + b i + c v + d i v = d (i + c/d) (v + b/d) + (a - b c / d)
        least = sign * (cut.at - a + b * c / d)
        shift = c / d
        if least <= 0.0 or -1.0 < shift < 0.0 or (source.image.wrap == "clip" and shift != 0.0):
            raise UnreadableAlphaError("alpha is not a product of image and attribute terms")
        scale = 1.0 + shift if shift >= 0.0 else shift
        factor = ImageFactor(source=source.image, gain=1.0 / scale, offset=shift / scale)
        alpha = sign * d * scale * (values + b / d) * (ALPHA_THRESHOLD / least)
        possible = (alpha >= ALPHA_THRESHOLD).any(1)  # no share of the image is above 1
        place = place[possible]
        if not len(place):
            return []
        return [
            _Piece(
                place=place,
                cut=self._number(factor, sides),
                uv=self._uv(triangles, place, factor),
                alpha=alpha[possible].astype(np.float32),
            )
        ]

    def _number(self, image: ImageAlpha | ImageFactor | None, sides: Sides) -> int:
        return self.alphas.cut_number(Cut(image=image, sides=sides))

    def _uv(
        self, triangles: Triangles, place: NDArray[np.int64], image: ImageAlpha | ImageFactor
    ) -> NDArray[np.float32]:
        """(N, 3, 2) texture coordinates; Cycles reads (0, 0) where the mesh has no such map."""
        values = corner_uv(self.mesh, image.source.uv_map, triangles.corners[place])
        if values is None:
            values = np.zeros((len(place), 3, 2), np.float32)
        uv = transform_uv(values, image.source.uv_transform)
        if not np.isfinite(uv).all():
            self.warnings.add(
                f"mesh {self.mesh.name!r} has texture coordinates that are NaN or infinite: "
                "read as 0"
            )
            uv[~np.isfinite(uv)] = 0.0
        return uv


def _at_constant(rule: AttributeAlpha, value: float) -> OneSided:
    """The rule where the attribute has one value all over the mesh."""
    source, of = rule.source, rule.of
    if not isinstance(source, ProductSource):
        return one_sided_rule(float(of(value)))
    if not source.everywhere and not 0.0 <= value <= 1.0:
        raise UnreadableAlphaError("alpha comes from an attribute beyond 0..1, cut off there")
    return one_sided_rule(Curve(source=source.image, of=lambda i: of(source.at(i, value))))


def _join_pieces(
    triangles: Triangles, pieces: list[_Piece]
) -> tuple[Triangles, TriangleCuts | None]:
    place = np.concatenate([p.place for p in pieces]) if pieces else np.empty(0, np.int64)
    order = np.argsort(place, kind="stable")
    left = Triangles(
        vertices=triangles.vertices[place[order]], corners=triangles.corners[place[order]]
    )
    if all(piece.cut < 0 for piece in pieces):
        return left, None
    count = [len(piece.place) for piece in pieces]
    uv = [
        np.zeros((n, 3, 2), np.float32) if p.uv is None else p.uv
        for n, p in zip(count, pieces, strict=True)
    ]
    alpha = None
    if any(piece.alpha is not None for piece in pieces):
        parts = [
            np.ones((n, 3), np.float32) if p.alpha is None else p.alpha
            for n, p in zip(count, pieces, strict=True)
        ]
        alpha = np.concatenate(parts)[order]
    cut = np.repeat(np.array([p.cut for p in pieces], np.int32), count)
    return left, TriangleCuts(cut=cut[order], uv=np.concatenate(uv)[order], alpha=alpha)
