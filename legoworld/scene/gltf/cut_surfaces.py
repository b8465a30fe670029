"""Primitives under their material's alpha: the remaining triangles and their cut-outs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import ALPHA_THRESHOLD
from legoworld.scene.gltf.accessors import as_float32
from legoworld.scene.gltf.cutouts import PictureCut, Pictures
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.materials import TextureAlpha, material_alpha, varying_alpha
from legoworld.scene.gltf.primitives import Primitive, Primitives
from legoworld.scene.gltf.verdicts import Budget, unreadable
from legoworld.scene.triangle_cuts import TriangleCuts

Left = tuple[NDArray[Any], TriangleCuts | None]
"""(T, 3) triangles of a primitive, and what cuts them."""


class CutSurfaces:
    """Cuts primitives by texture, factor and vertex colour."""

    def __init__(
        self, document: Fields, primitives: Primitives, pictures: Pictures, budget: Budget
    ) -> None:
        self._document = document
        self._primitives = primitives
        self._pictures = pictures
        self._budget = budget
        self._materials = document.children("materials")

    def cut(self, primitive: Primitive) -> Left | None:
        """The visible part of a primitive, (T, 3) and its cut; None if nothing is visible."""
        number = primitive.fields.index("material", len(self._materials))
        if number < 0:
            return primitive.triangles, None
        material = self._materials[number]
        if material.text("alphaMode", "OPAQUE") == "OPAQUE":
            return primitive.triangles, None
        alpha = self._vertex_alpha(primitive)
        if len(alpha) > 1:
            return self._cut_by_vertices(primitive, material, alpha)
        rule = material_alpha(self._document, material, float(alpha[0]))
        if rule == "gone":
            return None
        if rule == "opaque":
            return primitive.triangles, None
        cut = self._picture_cut(primitive, rule, primitive.triangles, rule.cutoff)
        if cut is None:
            return primitive.triangles, None
        cutout = np.full(len(primitive.triangles), cut[0], np.int32)
        return primitive.triangles, TriangleCuts(cut=cutout, uv=cut[1], alpha=None)

    def _vertex_alpha(self, primitive: Primitive) -> NDArray[np.float32]:
        """(V,) alpha of COLOR_0, or (1,) where all vertices have the same; 1 without one."""
        one = np.ones(1, np.float32)
        if "COLOR_0" not in primitive.fields.child("attributes"):
            return one
        stored = self._primitives.attribute(primitive.fields, "COLOR_0")
        if stored.values.shape[1] != 4 or not len(stored.values):
            return one
        if len(stored.values) != len(primitive.positions):
            raise unreadable(f"{primitive.fields.place}: COLOR_0 is not one a vertex")
        values = stored.values[:, 3:]
        if (values == values[0]).all():
            values = values[:1]
        self._budget.take(4 * len(values), "COLOR_0")
        alpha = as_float32(type(stored)(values=values, normalized=True))[:, 0]
        if not np.isfinite(alpha).all():
            raise unreadable(f"{primitive.fields.place}: COLOR_0 holds NaN or infinity")
        return alpha

    def _cut_by_vertices(
        self, primitive: Primitive, material: Fields, vertex_alpha: NDArray[np.float32]
    ) -> Left | None:
        rule = varying_alpha(self._document, material)
        if rule == "gone":
            return None
        if rule == "opaque":
            return primitive.triangles, None
        triangles = primitive.triangles
        self._budget.take(3 * 24 * len(triangles), "COLOR_0")
        exact = vertex_alpha.astype(np.float64) * rule.gain
        below = np.nextafter(np.float32(ALPHA_THRESHOLD), np.float32(0))
        # Rounding to float32 must not lift what is below the threshold to it.
        there = exact >= ALPHA_THRESHOLD
        alpha = np.where(there, exact, np.minimum(exact, below)).astype(np.float32)
        possible = there[triangles].any(1)  # no picture's alpha is above 1
        triangles = triangles[possible]
        if not len(triangles):
            return None
        picture = None
        if rule.texture is not None:
            picture = self._picture_cut(primitive, rule.texture, triangles, 1.0)
        if picture is None:
            whole = there[triangles].all(1)
            if whole.all():
                return triangles, None
            cutout = np.where(whole, -1, self._pictures.plain()).astype(np.int32)
            uv = np.zeros((len(triangles), 3, 2), np.float32)
            return triangles, TriangleCuts(cut=cutout, uv=uv, alpha=alpha[triangles])
        cutout = np.full(len(triangles), picture[0], np.int32)
        return triangles, TriangleCuts(cut=cutout, uv=picture[1], alpha=alpha[triangles])

    def _picture_cut(
        self, primitive: Primitive, rule: TextureAlpha, triangles: NDArray[Any], enough: float
    ) -> PictureCut | None:
        number = primitive.fields.index("material", len(self._materials))
        material = self._materials[number].text("name") or f"material {number}"
        name = f"TEXCOORD_{rule.uv_set}"
        if name not in primitive.fields.child("attributes"):
            self._pictures.warnings.add(
                f"material {material!r}: a mesh has no {name}; its surface is taken as opaque"
            )
            return None
        stored = self._primitives.attribute(primitive.fields, name)
        if stored.values.shape != (len(primitive.positions), 2):
            raise unreadable(f"{primitive.fields.place}: {name} is not VEC2 a vertex")
        self._budget.take(2 * 48 * len(triangles), name)
        uv = as_float32(stored)
        if not np.isfinite(uv).all():
            raise unreadable(f"{primitive.fields.place}: {name} holds NaN or infinity")
        return self._pictures.cut(rule, uv[triangles], material, enough=enough)
