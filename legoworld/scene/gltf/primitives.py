"""Mesh primitives as triangles: attributes from accessors or Draco, strips and fans unrolled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import NonFiniteGeometryError
from legoworld.scene.gltf.accessors import Accessors, StoredValues, as_float32
from legoworld.scene.gltf.buffers import Buffers
from legoworld.scene.gltf.draco import EXTENSION as DRACO
from legoworld.scene.gltf.draco import DracoMesh, DracoPayload
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.verdicts import Budget, unreadable

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_NO_SURFACE: Final = {0: "points", 1: "lines", 2: "lines", 3: "lines"}
#: Types KHR_mesh_quantization adds for positions; without it only float is allowed.
_QUANTIZED: Final = "KHR_mesh_quantization"


@dataclass(frozen=True, kw_only=True)
class Primitive:
    """positions: (V, 3) float32; triangles: (T, 3) unsigned indices below V.

    stored_as: what its positions were read from; primitives that share it share their vertices.
    """

    fields: Fields
    positions: NDArray[np.float32]
    triangles: NDArray[Any]
    stored_as: tuple[Any, ...]


class Primitives:
    """Reads primitives; Draco data is decoded before, see `draco_payload`."""

    def __init__(
        self, document: Fields, accessors: Accessors, draco: Mapping[str, DracoMesh], budget: Budget
    ) -> None:
        self.warnings: set[str] = set()
        self._accessors = accessors
        self._draco = draco
        self._budget = budget
        self._quantized = _QUANTIZED in document.texts("extensionsUsed")

    def read(self, fields: Fields, mesh_name: str) -> Primitive | None:
        """One primitive; None where it shows no surface.

        Raises UnreadableGltfError and NonFiniteGeometryError.
        """
        mode = fields.integer("mode", _TRIANGLES)
        if mode in _NO_SURFACE:
            self.warnings.add(f"mesh {mesh_name!r}: {_NO_SURFACE[mode]} are not read: no surface")
            return None
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            raise fields.wrong("mode", "0..6")
        attributes = fields.child("attributes")
        if "POSITION" not in attributes:
            self.warnings.add(f"mesh {mesh_name!r}: a primitive without positions is not read")
            return None
        stored = self.attribute(fields, "POSITION")
        if stored.values.shape[1] != 3 or not (self._quantized or stored.values.dtype.kind == "f"):
            raise attributes.wrong("POSITION", "VEC3 of float")
        if stored.values.dtype.kind != "f":
            self._budget.take(12 * len(stored.values), fields.place)
        positions = as_float32(stored)
        refuse_non_finite(positions, mesh_name)
        triangles = self._triangles(fields, mode, len(positions), mesh_name)
        if not len(triangles):
            return None
        return Primitive(
            fields=fields,
            positions=positions,
            triangles=triangles,
            stored_as=(fields.place,)
            if fields.place in self._draco
            else (attributes.values["POSITION"],),
        )

    def attribute(self, fields: Fields, name: str) -> StoredValues:
        """An attribute's values as they are stored. The primitive must have it."""
        attributes = fields.child("attributes")
        index = attributes.index(name, len(self._accessors))
        mesh = self._draco.get(fields.place)
        if mesh is None:
            return self._accessors.read(index)
        ids = _draco_ids(fields)
        if name not in ids:
            return self._accessors.read(index)
        layout, values = self._accessors.layout(index), mesh.attributes[ids[name]]
        if values.shape != (layout.count, layout.components) or values.dtype != layout.dtype:
            raise unreadable(
                f"{fields.place}: Draco's {name} is {values.dtype} of {values.shape}",
                f"{layout.dtype} of {(layout.count, layout.components)} as {layout.place} says",
            )
        return StoredValues(values=values, normalized=layout.normalized)

    def _triangles(
        self, fields: Fields, mode: int, n_vertices: int, mesh_name: str
    ) -> NDArray[Any]:
        mesh = self._draco.get(fields.place)
        if mesh is not None:
            triangles: NDArray[Any] = mesh.triangles
        else:
            triangles = self._unroll_indices(fields, mode, n_vertices, mesh_name)
        if len(triangles) and int(triangles.max()) >= n_vertices:
            raise unreadable(f"{fields.place} uses vertex {int(triangles.max())} of {n_vertices}")
        return triangles

    def _unroll_indices(
        self, fields: Fields, mode: int, n_vertices: int, mesh_name: str
    ) -> NDArray[Any]:
        indices = self._indices(fields, n_vertices)
        if mode == _TRIANGLES:
            whole = len(indices) // 3 * 3
            if whole != len(indices):
                self.warnings.add(f"mesh {mesh_name!r}: an incomplete last triangle is not read")
            return indices[:whole].reshape(-1, 3)
        count = max(len(indices) - 2, 0)
        self._budget.take(count * 3 * indices.itemsize, fields.place)
        triangles = np.empty((count, 3), indices.dtype)
        triangles[:, 0] = indices[:count] if mode == _STRIP else indices[:1]
        triangles[:, 1], triangles[:, 2] = indices[1 : count + 1], indices[2:]
        return triangles

    def _indices(self, fields: Fields, n_vertices: int) -> NDArray[Any]:
        if "indices" not in fields:
            self._budget.take(4 * n_vertices, fields.place)
            return np.arange(n_vertices, dtype=np.uint32)
        stored = self._accessors.read(fields.index("indices", len(self._accessors))).values
        if stored.dtype.kind != "u" or stored.shape[1] != 1:
            raise fields.wrong("indices", "a SCALAR accessor of unsigned integers")
        return stored[:, 0]


def draco_payload(fields: Fields, buffers: Buffers) -> DracoPayload | None:
    """What of a primitive is to be decoded; None where it is not Draco-compressed."""
    packed = fields.extension(DRACO)
    if packed is None:
        return None
    if "bufferView" not in packed:
        raise packed.wrong("bufferView", "an index")
    data, _ = buffers.view(packed.index("bufferView", len(buffers)))
    wanted = _draco_ids(fields)
    return DracoPayload(place=fields.place, data=bytes(data), attributes=tuple(wanted.values()))


def _draco_ids(fields: Fields) -> dict[str, int]:
    """The unique ids of a compressed primitive's attributes, by attribute name."""
    packed = fields.extension(DRACO)
    assert packed is not None
    named = packed.child("attributes")
    ids = {name: named.integer(name) for name in named.values}
    if "POSITION" not in ids or max(ids.values()) > 0xFFFFFFFF:
        raise unreadable(f"{named.place} names no positions")
    return ids


def refuse_non_finite(positions: NDArray[np.float32], mesh_name: str) -> None:
    """NonFiniteGeometryError where one of (V, 3) positions is NaN or infinite."""
    # A finite sum has finite terms; only an infinite or NaN one needs the second look.
    with np.errstate(all="ignore"):
        if np.isfinite(positions.sum()):
            return
    broken = int((~np.isfinite(positions)).any(axis=1).sum())
    if broken:
        raise NonFiniteGeometryError(
            f"mesh {mesh_name!r} has broken vertices",
            found=f"{broken} of {len(positions)} vertices hold NaN or infinity",
            expected="finite coordinates",
            next_step="remove those vertices, and export the scene again",
        )
