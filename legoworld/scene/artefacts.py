"""Checks of the artefacts that need no Blender: scene.glb and final.png."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

from legoworld.errors import SceneInvalidError
from legoworld.scene.gltf.accessors import Accessors
from legoworld.scene.gltf.buffers import Buffers, external_files
from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.gltf.nodes import node_tree
from legoworld.scene.gltf.snapshot import check_geometry
from legoworld.scene.gltf.verdicts import Budget
from legoworld.scene.pictures import decoded_picture

_PIXEL_CHUNKS: Final = (b"IHDR", b"PLTE", b"tRNS", b"gAMA", b"sRGB", b"IDAT", b"IEND")


def check_glb(path: Path) -> None:
    """Refuse a scene.glb that is empty or not well-formed, without decoding its geometry.

    Raises SceneInvalidError: the container, the JSON, the files it names, the node hierarchy, every
    accessor's range in its buffer view, and at least one mesh with positions are checked.
    """
    glb = parse_glb(path.read_bytes())
    external_files(glb.document, path.parent)
    node_tree(glb.document)
    budget = Budget(glb.file_bytes)
    buffers = Buffers(glb, path.parent, budget)
    check_geometry(glb.document, Accessors(glb.document, buffers, budget))


def check_picture(path: Path) -> None:
    """Refuse a final.png that is too large, does not decode or is a flat colour.

    Raises SceneInvalidError.
    """
    data = path.read_bytes()
    picture = decoded_picture(data, name=path.name)
    if picture is None:
        raise SceneInvalidError(
            f"{path.name} does not decode",
            found=f"{len(data)} bytes that are not a picture",
            expected="a PNG of the scene's render",
            next_step="render the scene again",
        )
    if all((row == picture[0, 0]).all() for row in picture):
        raise SceneInvalidError(
            f"{path.name} shows nothing",
            found=f"one flat colour over {picture.shape[1]}x{picture.shape[0]} pixels",
            expected="a render of the scene",
            next_step="check the camera, the lights and the render engine",
        )


def without_metadata(png: bytes) -> bytes:
    """A PNG reduced to its pixel chunks: Blender adds the folder, the date and timings."""
    signature, position = png[:8], 8
    kept = [signature]
    while position < len(png):
        (length,) = struct.unpack_from(">I", png, position)
        end = position + 12 + length
        if png[position + 4 : position + 8] in _PIXEL_CHUNKS:
            kept.append(png[position:end])
        position = end
    return b"".join(kept)
