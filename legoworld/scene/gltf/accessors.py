"""Accessors as arrays: strided views where they can be, sparse and normalised values resolved.

glTF 2.0 specification, 3.6.2. Every range is checked against its buffer before an array is made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.gltf.buffers import Buffers
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.verdicts import Budget, unreadable

_DTYPES: Final[dict[int, np.dtype[Any]]] = {
    5120: np.dtype("<i1"), 5121: np.dtype("<u1"), 5122: np.dtype("<i2"),
    5123: np.dtype("<u2"), 5125: np.dtype("<u4"), 5126: np.dtype("<f4"),
}  # fmt: skip
_COMPONENTS: Final = {
    "SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16
}  # fmt: skip
#: Matrices of small integers begin each column at a multiple of 4 bytes.
_PADDED: Final = {("MAT2", 1): 8, ("MAT3", 1): 12, ("MAT3", 2): 24}
_UNSIGNED: Final = (5121, 5123, 5125)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """An accessor's declared type and size. element_bytes: with column padding."""

    place: str
    kind: str
    dtype: np.dtype[Any]
    count: int
    normalized: bool
    element_bytes: int

    @property
    def components(self) -> int:
        """Numbers in one element."""
        return _COMPONENTS[self.kind]


@dataclass(frozen=True, kw_only=True)
class StoredValues:
    """Values as the file stores them. values: (count, components), perhaps a strided view."""

    values: NDArray[Any]
    normalized: bool


class Accessors:
    """The accessors of a document."""

    def __init__(self, document: Fields, buffers: Buffers, budget: Budget) -> None:
        self._fields = document.children("accessors")
        self._buffers = buffers
        self._budget = budget

    def __len__(self) -> int:
        return len(self._fields)

    def layout(self, index: int) -> Layout:
        """An accessor's type and size, checked, without its values."""
        fields = self._fields[index]
        component, kind = fields.integer("componentType"), fields.text("type")
        if component not in _DTYPES:
            raise fields.wrong("componentType", "5120..5123, 5125 or 5126")
        if kind not in _COMPONENTS:
            raise fields.wrong("type", ", ".join(_COMPONENTS))
        size = _DTYPES[component].itemsize
        return Layout(
            place=fields.place,
            kind=kind,
            dtype=_DTYPES[component],
            count=fields.integer("count"),
            normalized=fields.flag("normalized"),
            element_bytes=_PADDED.get((kind, size), size * _COMPONENTS[kind]),
        )

    def read(self, index: int) -> StoredValues:
        """An accessor's values. Without a buffer view and sparse values they are zeros."""
        fields, layout = self._fields[index], self.layout(index)
        if "bufferView" in fields:
            values = self._elements(fields, layout)
        else:
            self._take(layout)
            values = np.zeros((layout.count, layout.components), layout.dtype)
        if "sparse" in fields:
            if "bufferView" in fields:
                self._take(layout)
                values = values.copy()
            self._overwrite(fields.child("sparse"), layout, values)
        return StoredValues(values=values, normalized=layout.normalized)

    def check(self, index: int) -> None:
        """Raises UnreadableGltfError unless the accessor and its sparse part lie in their views."""
        fields, layout = self._fields[index], self.layout(index)
        if "bufferView" in fields:
            self._range(fields, layout)
        if "sparse" in fields:
            self._sparse_parts(fields.child("sparse"), layout)

    def _take(self, layout: Layout) -> None:
        self._budget.take(layout.count * layout.element_bytes, layout.place)

    def _elements(self, fields: Fields, layout: Layout) -> NDArray[Any]:
        """(count, components) view of a buffer view, the accessor's own or a sparse part's."""
        data, start, step = self._range(fields, layout)
        if layout.element_bytes != layout.dtype.itemsize * layout.components:
            raise unreadable(f"{fields.place} is a matrix of small integers", "a type in use")
        if not layout.count:
            return np.zeros((0, layout.components), layout.dtype)
        return np.ndarray(
            (layout.count, layout.components),
            layout.dtype,
            data,
            start,
            (step, layout.dtype.itemsize),
        )

    def _range(self, fields: Fields, layout: Layout) -> tuple[memoryview, int, int]:
        """The bytes of a buffer view, the first element's offset and the step between elements."""
        if "bufferView" not in fields:
            raise fields.wrong("bufferView", "an index")
        data, stride = self._buffers.view(fields.index("bufferView", len(self._buffers)))
        start = fields.integer("byteOffset", 0)
        step = stride or layout.element_bytes
        if step < layout.element_bytes:
            raise unreadable(f"{fields.place}: byteStride {step} is less than an element")
        needed = start + step * (layout.count - 1) + layout.element_bytes if layout.count else 0
        if needed > len(data):
            raise unreadable(f"{fields.place} needs {needed} bytes of a view of {len(data)}")
        return data, start, step

    def _sparse_parts(self, sparse: Fields, layout: Layout) -> tuple[NDArray[Any], NDArray[Any]]:
        count, where = sparse.integer("count"), sparse.child("indices")
        component = where.integer("componentType")
        if component not in _UNSIGNED:
            raise where.wrong("componentType", "5121, 5123 or 5125")
        if count > layout.count:
            raise sparse.wrong("count", f"at most {layout.count}")
        dtype = _DTYPES[component]
        places = Layout(
            place=where.place, kind="SCALAR", dtype=dtype, count=count, normalized=False,
            element_bytes=dtype.itemsize,
        )  # fmt: skip
        values = Layout(**{**layout.__dict__, "count": count})
        return (self._elements(where, places)[:, 0], self._elements(sparse.child("values"), values))

    def _overwrite(self, sparse: Fields, layout: Layout, values: NDArray[Any]) -> None:
        places, written = self._sparse_parts(sparse, layout)
        if len(places) and int(places.max()) >= layout.count:
            raise unreadable(
                f"{sparse.place} changes element {int(places.max())} of {layout.count}"
            )
        values[places] = written


def as_float32(stored_values: StoredValues) -> NDArray[np.float32]:
    """(count, components) float32; normalised integers by the specification's table in 3.11.

    float32 values are returned as they are stored, without a copy.
    """
    values = stored_values.values
    if values.dtype.kind == "f":
        return values
    floats = values.astype(np.float32)
    if stored_values.normalized:
        floats /= np.float32(np.iinfo(values.dtype).max)
        if values.dtype.kind == "i":
            np.maximum(floats, -1.0, out=floats)
    return floats
