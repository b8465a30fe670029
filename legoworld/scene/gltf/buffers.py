"""A document's bytes: the binary chunk, data URIs, and files inside the scene folder."""

from __future__ import annotations

import base64
import binascii
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

from legoworld.errors import SceneInvalidError, cause
from legoworld.scene.gltf.container import Glb
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.verdicts import Budget, UnsupportedGltfError, unreadable

_DATA: Final = "data:"
MESHOPT: Final = "EXT_meshopt_compression"


def external_files(document: Fields, folder: Path) -> list[str]:
    """External files that scene.glb refers to, existing or not, relative to the scene folder.

    Raises SceneInvalidError for a URI that points outside the folder.
    """
    owners = (*document.children("buffers"), *document.children("images"))
    uris = {owner.text("uri") for owner in owners if "uri" in owner}
    return sorted(_relative(uri, folder) for uri in uris if not uri.startswith(_DATA))


class Buffers:
    """The buffers and buffer views of a document, each checked when it is first used."""

    def __init__(self, glb: Glb, folder: Path, budget: Budget) -> None:
        self._glb = glb
        self._folder = folder
        self._budget = budget
        self._buffers = glb.document.children("buffers")
        self._views = glb.document.children("bufferViews")
        self._loaded: dict[int, memoryview] = {}

    def __len__(self) -> int:
        return len(self._views)

    def view(self, index: int) -> tuple[memoryview, int]:
        """The bytes of a buffer view and its byteStride (0: tightly packed)."""
        view = self._views[index]
        if "buffer" not in view:
            raise view.wrong("buffer", "an index")
        number = view.index("buffer", len(self._buffers))
        self._refuse_meshopt(view, number)
        start, length = view.integer("byteOffset", 0), view.integer("byteLength")
        stride = view.integer("byteStride", 0)
        if "byteStride" in view and not 4 <= stride <= 252:
            raise view.wrong("byteStride", "4..252")
        data = self._buffer(number)
        if start + length > len(data):
            raise unreadable(f"{view.place} ends at byte {start + length} of {len(data)}")
        return data[start : start + length], stride

    def uri(self, owner: Fields) -> memoryview | None:
        """The bytes of a `uri`; None for a missing file."""
        uri = owner.text("uri")
        if uri.startswith(_DATA):
            return self._data_uri(owner, uri)
        path = self._folder / _relative(uri, self._folder)
        if not path.is_file():
            return None
        self._budget.take(path.stat().st_size, owner.place)
        try:
            return memoryview(path.read_bytes())
        except OSError as error:
            raise unreadable(f"{owner.place}: {uri!r} cannot be read: {cause(error)}") from error

    def _refuse_meshopt(self, view: Fields, number: int) -> None:
        packed = view.extension(MESHOPT)
        placeholder = self._buffers[number].extension(MESHOPT)
        if packed is not None and placeholder is not None:
            raise UnsupportedGltfError(
                "scene.glb is compressed with meshopt, which is not read",
                found=f"{MESHOPT} in {view.place} without an uncompressed copy",
                expected="plain or Draco-compressed buffers",
                next_step="export without meshopt compression, or use --source blend",
            )

    def _buffer(self, number: int) -> memoryview:
        if number not in self._loaded:
            self._loaded[number] = self._load(number)
        return self._loaded[number]

    def _load(self, number: int) -> memoryview:
        buffer = self._buffers[number]
        length = buffer.integer("byteLength")
        data: memoryview | None
        if "uri" in buffer:
            data = self.uri(buffer)
        else:
            data = self._glb.binary if number == 0 else None
        if data is None:
            raise unreadable(f"{buffer.place} has no bytes: its file or chunk is not there")
        if length > len(data):
            raise unreadable(f"{buffer.place} should have {length} bytes and has {len(data)}")
        return data[:length]

    def _data_uri(self, owner: Fields, uri: str) -> memoryview:
        head, comma, body = uri.partition(",")
        if not comma or not head.endswith(";base64"):
            raise owner.wrong("uri", "a base64 data URI")
        try:
            return memoryview(base64.b64decode(unquote(body), validate=True))
        except (binascii.Error, ValueError) as error:
            raise unreadable(f"{owner.at('uri')}: {error}") from error


def image_bytes(image: Fields, buffers: Buffers) -> bytes | None:
    """An image's file, from its buffer view or URI; None for a missing one."""
    if "bufferView" in image:
        return bytes(buffers.view(image.index("bufferView", len(buffers)))[0])
    content = buffers.uri(image) if "uri" in image else None
    return None if content is None else bytes(content)


def _relative(uri: str, folder: Path) -> str:
    """A URI as a path inside the folder. Raises SceneInvalidError where it is not one."""
    refused = SceneInvalidError(
        "scene.glb names a file outside its folder",
        found=uri[:200],
        expected="a relative path inside the scene folder",
        next_step="export a self-contained .glb",
    )
    try:
        parts = urlsplit(uri)
        name = unquote(parts.path, errors="strict")
        outside = bool(parts.scheme or parts.netloc or parts.query or parts.fragment)
        if outside or not name or "\\" in name or ":" in name or "\0" in name:
            raise refused
        root = folder.resolve()
        return (root / name).resolve().relative_to(root).as_posix()
    except (ValueError, OSError, RuntimeError) as error:
        raise refused from error
