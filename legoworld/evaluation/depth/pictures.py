"""Arrays out of the file formats depth comes in: .npy, .npz, PFM, 16-bit PNG or PGM, EXR, raw."""

from __future__ import annotations

import importlib
from collections.abc import Container
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.depth.errors import DepthFileError

#: Suffixes in the order they are looked for.
SUFFIXES: Final = (".npz", ".npy", ".pfm", ".exr", ".png", ".pgm")
_JPEG: Final = b"\xff\xd8\xff"


def refuse_photo(path: Path) -> None:
    """DepthFileError when a file is a JPEG: ETH3D's raw depth and photos share their names."""
    with path.open("rb") as stream:
        start = stream.read(3)
    if start == _JPEG:
        raise DepthFileError(
            f"{path.name}: this is the RGB, not the depth",
            found="a JPEG (FF D8 FF)",
            expected="measured depth",
            next_step="point at ground_truth_depth/, not at images/",
        )


def read_picture(path: Path) -> NDArray[Any]:
    """The (H, W) array of a one-array file (every suffix but .npz), numbers as stored."""
    refuse_photo(path)
    readers = {
        ".npy": _read_npy,
        ".pfm": read_pfm,
        ".exr": read_exr,
        ".png": _read_integers,
        ".pgm": _read_integers,
    }
    if path.suffix.lower() not in readers:
        raise DepthFileError(
            f"{path.name} has no depth format", found=path.suffix, expected=", ".join(SUFFIXES)
        )
    return readers[path.suffix.lower()](path)


def read_npz(path: Path, wanted: Container[str]) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """The wanted arrays of an .npz, and the names of all it has.

    DepthFileError when it is no .npz, is damaged, or holds pickled objects.
    """
    refuse_photo(path)
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            names = list(archive.files)
            return {name: archive[name] for name in names if name in wanted}, names
    except (OSError, ValueError, EOFError, AttributeError, TypeError, BadZipFile) as error:
        raise DepthFileError(
            f"{path.name} cannot be read", found=str(error), expected="an .npz of plain arrays"
        ) from error


def read_raw_float32(path: Path, size_wh: tuple[int, int]) -> NDArray[np.float32]:
    """ETH3D's depth: headerless little-endian float32, row major, as (H, W).

    DepthFileError when the file is a photo, or its bytes are not 4 * W * H.
    """
    check_raw_float32(path, size_wh)
    values = np.fromfile(path, dtype="<f4").reshape(size_wh[1], size_wh[0])
    return values.astype(np.float32, copy=False)


def check_raw_float32(path: Path, size_wh: tuple[int, int]) -> None:
    """What can be said of a raw depth file without reading it."""
    refuse_photo(path)
    width, height = size_wh
    expected, found = 4 * width * height, path.stat().st_size
    if found != expected:
        raise DepthFileError(
            f"{path.name} is no raw depth of this size",
            found=f"{found} bytes",
            expected=f"{expected} bytes = 4 x {width} x {height}",
            next_step="check the download, and cameras.txt for the size",
        )


def read_pfm(path: Path) -> NDArray[np.float32]:
    """A one-channel PFM, either byte order, first row on top (the file's rows go upwards)."""
    with path.open("rb") as stream:
        magic = stream.readline(16).strip()
        header = [stream.readline(64)]
        while header[-1].startswith(b"#"):
            header[-1] = stream.readline(64)
        header.append(stream.readline(64))
        data = stream.read()
    try:
        width, height = (int(x) for x in header[0].split())
        scale = float(header[1])
    except ValueError:
        width = height = 0
        scale = 0.0
    if magic != b"Pf" or min(width, height) < 1 or not np.isfinite(scale) or scale == 0:
        raise DepthFileError(
            f"{path.name} is no one-channel PFM",
            found=repr(b" ".join([magic, *(h.strip() for h in header)]))[:100],
            expected="Pf, width and height, a scale whose sign is the byte order",
        )
    if len(data) != 4 * width * height:
        raise DepthFileError(
            f"{path.name} is cut or has more than its header says",
            found=f"{len(data)} bytes of pixels",
            expected=f"{4 * width * height} = 4 x {width} x {height}",
        )
    values = np.frombuffer(data, "<f4" if scale < 0 else ">f4").reshape(height, width)
    return np.ascontiguousarray(values[::-1]).astype(np.float32, copy=False)


def read_exr(path: Path) -> NDArray[np.float32]:
    """Channel Z of an EXR, float32 (needs the OpenEXR package, version 3 or later)."""
    try:
        openexr = importlib.import_module("OpenEXR")
    except ImportError as error:
        raise DepthFileError(
            f"{path.name} needs a reader of EXR",
            found="the package OpenEXR is not installed",
            expected="OpenEXR 3",
            next_step='pip install "legoworld[exr]"',
        ) from error
    try:
        with openexr.File(str(path)) as file:
            # A single channel keeps its own name only when channels are not grouped into RGB(A).
            channels = {name: c.pixels for name, c in file.channels().items()}
    except (RuntimeError, ValueError, OSError) as error:
        raise DepthFileError(f"{path.name} cannot be read", found=str(error)) from error
    names = [n for n in channels if n == "Z" or n.endswith(".Z")]
    if len(names) != 1 or channels[names[0]].dtype != np.float32:
        found = ", ".join(f"{n} {c.dtype}" for n, c in sorted(channels.items()))
        raise DepthFileError(
            f"{path.name} has no single float32 depth channel",
            found=found,
            expected="one channel Z (or <layer>.Z), float32",
        )
    values: NDArray[np.float32] = channels[names[0]]
    return values


def _read_npy(path: Path) -> NDArray[Any]:
    try:
        with path.open("rb") as stream:
            values = np.load(stream, allow_pickle=False)
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise DepthFileError(
            f"{path.name} cannot be read", found=str(error), expected="an .npy of plain numbers"
        ) from error
    if not isinstance(values, np.ndarray):
        raise DepthFileError(f"{path.name} is an .npz by its content", expected="one array")
    return values


def _read_integers(path: Path) -> NDArray[Any]:
    import cv2

    values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if values is None:
        raise DepthFileError(f"{path.name} cannot be read", expected="a 16-bit PNG or PGM")
    return values
