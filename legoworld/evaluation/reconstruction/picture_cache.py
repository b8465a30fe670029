"""Resized references, kept between evaluations: decoding one takes longer than all of R."""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import Final

import numpy as np
from PIL import __version__ as pillow_version

from legoworld.evaluation.reconstruction.appearance import Picture, decode_picture, resize_picture
from legoworld.files import atomic_path, sha256_of_text
from legoworld.scene.cache import default_cache_folder

_FOLDER: Final = "references"


def resized_reference(data: bytes, sha256: str, size_wh: tuple[int, int]) -> Picture:
    """A reference picture at A's size: from the cache by content, size and Pillow's version.

    (H, W, 3). data: the file's bytes, sha256: theirs. A damaged entry is made again; an unwritable
    cache costs time alone. PictureError where the bytes are no picture.
    """
    key = sha256_of_text(f"{sha256} {size_wh[0]}x{size_wh[1]} {pillow_version}")
    path = default_cache_folder() / _FOLDER / key[:2] / f"{key}.npy"
    kept = _read(path, size_wh)
    if kept is not None:
        return kept
    made = resize_picture(decode_picture(data), size_wh)
    _write(path, made)
    return made


def _read(path: Path, size_wh: tuple[int, int]) -> Picture | None:
    try:
        stored = path.read_bytes()
        content, digest = stored[:-64], stored[-64:]
        if _sha256(content) != digest.decode("ascii"):
            return None
        picture = np.load(io.BytesIO(content), allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    return picture if picture.shape == (size_wh[1], size_wh[0], 3) else None


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _write(path: Path, picture: Picture) -> None:
    stream = io.BytesIO()
    np.save(stream, picture, allow_pickle=False)
    content = stream.getvalue()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_bytes(content + _sha256(content).encode("ascii"))
    except OSError:
        return
