"""Checks of the artefacts that need no Blender: scene.glb and final.png."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np

from legoworld.errors import SceneInvalidError

_MAGIC: Final = 0x46546C67  # "glTF"
_JSON: Final = 0x4E4F534A
_COMPONENT_BYTES: Final = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS: Final = {
    "SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16
}  # fmt: skip


def check_glb(path: Path) -> None:
    """Refuse a scene.glb that is empty or not well formed (glTF 2.0 specification, 4.4 and 3.6).

    Raises SceneInvalidError: the container, the chunk lengths, the JSON, every accessor's range
    in its buffer view, and at least one mesh with positions are checked.
    """
    data = path.read_bytes()
    if len(data) < 20:
        raise _glb(f"{len(data)} bytes")
    magic, version, length = struct.unpack_from("<III", data)
    if magic != _MAGIC:
        raise _glb(f"it begins with {data[:4]!r}")
    if version != 2:
        raise _glb(f"version {version}")
    if length != len(data):
        raise _glb(f"its header says {length} bytes, the file has {len(data)}")
    json_length, kind = struct.unpack_from("<II", data, 12)
    if kind != _JSON or 20 + json_length > len(data):
        raise _glb("its first chunk is not whole JSON")
    try:
        document = json.loads(data[20 : 20 + json_length])
    except ValueError as error:
        raise _glb(f"its JSON does not parse: {error}") from error
    binary_length = _binary_length(data, 20 + json_length)
    try:
        _check_document(document, binary_length)
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise _glb(f"its JSON does not follow glTF: {type(error).__name__} {error}") from error


def check_picture(path: Path) -> None:
    """Refuse a final.png that does not decode or is one flat colour. Raises SceneInvalidError."""
    import cv2

    data = np.frombuffer(path.read_bytes(), np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    if picture is None:
        raise SceneInvalidError(
            f"{path.name} does not decode",
            found=f"{len(data)} bytes that are no picture",
            expected="a PNG of the scene's render",
            next_step="render the scene again",
        )
    flat = picture.reshape(-1, picture.shape[2] if picture.ndim == 3 else 1)
    if (flat == flat[0]).all():
        raise SceneInvalidError(
            f"{path.name} shows nothing",
            found=f"one flat colour over {picture.shape[1]}x{picture.shape[0]} pixels",
            expected="a render of the scene",
            next_step="check the camera, the lights and the render engine",
        )


def _binary_length(data: bytes, offset: int) -> int:
    if offset + 8 > len(data):
        return 0
    length, _ = struct.unpack_from("<II", data, offset)
    if offset + 8 + length > len(data):
        raise _glb("its binary chunk is cut short")
    return int(length)


def _check_document(document: dict[str, Any], binary_length: int) -> None:
    views = document.get("bufferViews", [])
    buffers = document.get("buffers", [])
    accessors = document.get("accessors", [])
    for view in views:
        buffer = buffers[view["buffer"]]
        limit = buffer["byteLength"] if "uri" in buffer else min(
            buffer["byteLength"], binary_length
        )  # fmt: skip
        if view.get("byteOffset", 0) + view["byteLength"] > limit:
            raise _glb("a buffer view reaches past its buffer")
    for accessor in accessors:
        if "bufferView" in accessor:
            _check_accessor(accessor, views[accessor["bufferView"]])
    primitives = [p for mesh in document.get("meshes", []) for p in mesh["primitives"]]
    with_positions = [p for p in primitives if "POSITION" in p["attributes"]]
    if not any(accessors[p["attributes"]["POSITION"]]["count"] for p in with_positions):
        raise _glb("no mesh with positions")


def _check_accessor(accessor: dict[str, Any], view: dict[str, Any]) -> None:
    element = _COMPONENT_BYTES[accessor["componentType"]] * _COMPONENTS[accessor["type"]]
    count = accessor["count"]
    stride = view.get("byteStride", element)
    needed = accessor.get("byteOffset", 0) + (stride * (count - 1) + element if count else 0)
    if needed > view["byteLength"]:
        raise _glb("an accessor reaches past its buffer view")


def _glb(found: str) -> SceneInvalidError:
    return SceneInvalidError(
        "scene.glb is not a usable glTF binary",
        found=found,
        expected="a whole glTF 2.0 .glb with at least one mesh",
        next_step="export the scene again",
    )
