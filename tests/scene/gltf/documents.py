"""Small .glb files made by hand, and what their camera sees."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.gltf.snapshot import read_glb_snapshot
from legoworld.scene.instances import group
from legoworld.scene.labels import resolve_labels
from legoworld.scene.snapshot import Snapshot
from legoworld.visibility.view import view

COMPONENT_TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
SIDE = 64


class Document:
    """A glTF document under construction. A unit is a pixel of its orthographic camera."""

    def __init__(self, *, camera: bool = True) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"name": "Scene", "nodes": []}],
        }
        self.binary = bytearray()
        if camera:
            lens = {"xmag": SIDE / 2, "ymag": SIDE / 2, "znear": 0.1, "zfar": 100}
            self.camera({"type": "orthographic", "orthographic": lens})

    def add(self, kind: str, **fields: Any) -> int:
        entries = self.json.setdefault(kind, [])
        entries.append(fields)
        return len(entries) - 1

    def view(self, data: bytes, **fields: Any) -> int:
        self.binary += bytes(-len(self.binary) % 4)
        start = len(self.binary)
        self.binary += data
        return self.add("bufferViews", buffer=0, byteOffset=start, byteLength=len(data), **fields)

    def accessor(self, values: Any, dtype: str = "f4", **fields: Any) -> int:
        array = np.asarray(values).astype("<" + dtype)
        array = array.reshape(len(array), -1) if len(array) else array.reshape(0, 1)
        return self.add(
            "accessors",
            bufferView=self.view(array.tobytes()),
            componentType=COMPONENT_TYPES[dtype],
            count=len(array),
            type=TYPES[array.shape[1]],
            **fields,
        )

    def mesh(self, positions: Any, indices: Any = None, **fields: Any) -> int:
        """A mesh of one primitive."""
        return self.add("meshes", primitives=[self.primitive(positions, indices, **fields)])

    def primitive(self, positions: Any, indices: Any = None, **fields: Any) -> dict[str, Any]:
        attributes = {"POSITION": self.accessor(positions), **fields.pop("attributes", {})}
        made = {"attributes": attributes, **fields}
        if indices is not None:
            made["indices"] = self.accessor(indices, "u2")
        return made

    def node(self, *, root: bool = True, **fields: Any) -> int:
        index = self.add("nodes", **fields)
        if root:
            self.json["scenes"][0]["nodes"].append(index)
        return index

    def camera(self, camera: dict[str, Any], **node: Any) -> int:
        number = self.add("cameras", **camera)
        placed = {"name": "Camera", "translation": [0, 0, 10]}
        return self.node(camera=number, **(placed | node))

    def quad(
        self, name: str, x: float, y: float, side: float = 8, z: float = 0, **node: Any
    ) -> int:
        """A square whose lower left corner is (x, y)."""
        mesh = self.mesh(*square(x, y, side, z))
        return self.node(name=name, mesh=mesh, **node)

    def textured_quad(self, material: dict[str, Any], uv: Any, x: float = 0, y: float = 0,
                      side: float = 8, name: str = "Card") -> int:  # fmt: skip
        number = self.add("materials", **material)
        positions, indices = square(x, y, side)
        attributes = {"TEXCOORD_0": self.accessor(uv)}
        mesh = self.mesh(positions, indices, attributes=attributes, material=number)
        return self.node(name=name, mesh=mesh)

    def texture(self, alpha: Any, **sampler: Any) -> int:
        """A PNG whose alpha, top row first, is given in 0..255."""
        return self.picture(png_of_alpha(alpha), "image/png", **sampler)

    def picture(self, data: bytes, mime: str, **sampler: Any) -> int:
        image = self.add("images", bufferView=self.view(data), mimeType=mime)
        number = self.add("samplers", **({"magFilter": 9728} | sampler))
        return self.add("textures", source=image, sampler=number)

    def glb(self) -> bytes:
        document = dict(self.json)
        if self.binary and "buffers" not in document:
            document["buffers"] = [{"byteLength": len(self.binary)}]
        return glb_of(json.dumps(document).encode(), bytes(self.binary))


def glb_of(text: bytes, binary: bytes = b"") -> bytes:
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def square(x: float, y: float, side: float, z: float = 0) -> tuple[list[Any], list[int]]:
    corners = [(x, y, z), (x + side, y, z), (x + side, y + side, z), (x, y + side, z)]
    return corners, [0, 1, 2, 0, 2, 3]


def png_of_alpha(alpha: Any) -> bytes:
    values = np.asarray(alpha, np.uint8)
    picture = np.full((*values.shape, 4), 200, np.uint8)
    picture[..., 3] = values
    done, data = cv2.imencode(".png", picture)
    assert done
    return data.tobytes()


def read(glb: bytes, folder: Path = Path("nowhere")) -> Snapshot:
    return read_glb_snapshot(parse_glb(glb), folder)


def boxes(
    glb: bytes | Snapshot, size_wh: tuple[int, int] = (SIDE, SIDE)
) -> list[tuple[str, int, tuple[int, int, int, int]]]:
    """(name, area, (x0, y0, x1, y1)) of every instance that is seen, sorted."""
    snapshot = glb if isinstance(glb, Snapshot) else read(glb)
    grouping = group(snapshot, resolve_labels(snapshot, (), None, None))
    seen = view(snapshot, grouping, size_wh, threads=1)
    return sorted(
        (i.name, int(seen.area_px[i.id]), tuple(seen.bbox_xyxy_px[i.id].tolist()))
        for i in grouping.instances
        if seen.area_px[i.id]
    )


def mask(glb: bytes, size_wh: tuple[int, int] = (SIDE, SIDE)) -> np.ndarray:
    """Where any surface is seen, rows from the top."""
    snapshot = read(glb)
    grouping = group(snapshot, resolve_labels(snapshot, (), None, None))
    return view(snapshot, grouping, size_wh, threads=1).buffers.instance >= 0
