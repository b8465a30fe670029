"""The .glb container: header, chunks and the JSON document (glTF 2.0 specification, chapter 4)."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Any, Final

from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.verdicts import UnsupportedGltfError, unreadable

_MAGIC: Final = 0x46546C67  # "glTF"
_JSON: Final = 0x4E4F534A
_BINARY: Final = 0x004E4942
_HEADER: Final = struct.Struct("<III")
_CHUNK: Final = struct.Struct("<II")

#: Extensions the reader supports, or may ignore because no surface depends on them.
_READ: Final = frozenset(
    {
        "EXT_mesh_gpu_instancing",
        "EXT_meshopt_compression",
        "EXT_texture_avif",
        "EXT_texture_webp",
        "KHR_animation_pointer",
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_mesh_quantization",
        "KHR_node_visibility",
        "KHR_texture_basisu",
        "KHR_texture_transform",
        "KHR_xmp_json_ld",
        "MSFT_texture_dds",
    }
)
_APPEARANCE: Final = "KHR_materials_"


@dataclass(frozen=True, kw_only=True)
class Glb:
    """A parsed .glb. binary: the bytes of its binary chunk, None without one."""

    document: Fields
    binary: memoryview | None
    file_bytes: int


def parse_glb(data: bytes) -> Glb:
    """Parse a .glb. Raises UnreadableGltfError, or UnsupportedGltfError for what it requires.

    Checked: magic, version, the lengths of the file and of every chunk, the JSON, asset.version
    and extensionsRequired. Chunks of other kinds are skipped as the specification says.
    """
    if len(data) < _HEADER.size + _CHUNK.size:
        raise unreadable(f"{len(data)} bytes")
    magic, version, length = _HEADER.unpack_from(data)
    if magic != _MAGIC:
        raise unreadable(f"it begins with {data[:4]!r}")
    if version != 2:
        raise unreadable(f"version {version}")
    if length != len(data):
        raise unreadable(f"its header says {length} bytes, the file has {len(data)}")
    chunks = _chunks(data)
    if not chunks or chunks[0][0] != _JSON:
        raise unreadable("its first chunk is not JSON")
    document = _document(chunks[0][1])
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == _BINARY else None
    return Glb(document=document, binary=binary, file_bytes=len(data))


def _chunks(data: bytes) -> list[tuple[int, memoryview]]:
    view, offset, chunks = memoryview(data), _HEADER.size, []
    while offset < len(data):
        if offset + _CHUNK.size > len(data):
            raise unreadable("a chunk's header is cut short")
        length, kind = _CHUNK.unpack_from(data, offset)
        offset += _CHUNK.size
        if length > len(data) - offset:
            raise unreadable(f"a chunk of {length} bytes is cut short")
        chunks.append((kind, view[offset : offset + length]))
        offset += length
    return chunks


def _document(text: memoryview) -> Fields:
    def refuse(constant: str) -> Any:
        raise ValueError(f"{constant} is not JSON")

    try:
        values = json.loads(str(text, "utf-8"), parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise unreadable(f"its JSON does not parse: {error}") from error
    if not isinstance(values, dict):
        raise unreadable(f"its JSON is a {type(values).__name__}")
    document = Fields(values)
    written = document.child("asset").text("version")
    if written.split(".")[0] != "2":
        raise unreadable(f"asset.version is {written!r}", "2.0")
    required = document.texts("extensionsRequired")
    unknown = sorted(e for e in required if e not in _READ and not e.startswith(_APPEARANCE))
    if unknown:
        raise UnsupportedGltfError(
            "scene.glb requires an extension that is not read",
            found=", ".join(unknown),
            expected=", ".join(sorted(_READ)) + f" or {_APPEARANCE}*",
            next_step="export without it, or use --source blend",
        )
    return document
