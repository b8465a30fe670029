"""Arrays from the file formats of depth; see `SUFFIXES`, and ETH3D's raw float32."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Container, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.exr import read_exr
from legoworld.depth_files.headers import (
    SizeCheck,
    check_claim,
    npy_claim,
    pfm_claim,
    pgm_claim,
    png_claim,
    tiff_claim,
)
from legoworld.errors import cause
from legoworld.files import names_a_file

#: Suffixes in lookup order.
SUFFIXES: Final = (".npz", ".npy", ".pfm", ".exr", ".png", ".pgm", ".tiff", ".tif")
#: Maximum size of a declaration in an .npz, in bytes.
_LABEL_BYTES: Final = 4096
#: Of all arrays that are read at once: four depth maps of the largest size.
_MOST_BYTES: Final = 1 << 30
_JPEG: Final = b"\xff\xd8\xff"


def refuse_photo(path: Path) -> None:
    """Raise DepthFileError for a JPEG: ETH3D's raw depth and photos have the same names."""
    with path.open("rb") as stream:
        start = stream.read(3)
    if start == _JPEG:
        raise DepthFileError(
            f"{path.name} is the photo, not the depth",
            found="a JPEG (FF D8 FF)",
            expected="measured depth",
            next_step="point at ground_truth_depth/, not at images/",
        )


@dataclass(frozen=True, kw_only=True)
class Npz:
    """Contents of an .npz. names: of all arrays; labels: the small arrays that were requested."""

    names: tuple[str, ...]
    pictures: tuple[str, ...]
    labels: dict[str, NDArray[Any]]


def files_named(stem: Path) -> list[Path]:
    """The depth files of a path without suffix, whose suffix may be in capitals."""
    files = []
    for suffix in SUFFIXES:
        small, capital = (stem.with_name(stem.name + s) for s in (suffix, suffix.upper()))
        files += [small] if names_a_file(small) else [capital] if names_a_file(capital) else []
    return files


def read_picture(
    path: Path,
    *,
    channel: str | None = None,
    check_size: SizeCheck | None = None,
    channels: int = 1,
) -> tuple[NDArray[Any], str | None]:
    """The array of a one-array file (every suffix but .npz), numbers as stored.

    channel: an EXR's, None to find it. check_size: called with the size before the array is read.
    channels: numbers of a pixel that an .npy or .exr must have; a PNG's are as decoded. Returns the
    array, (H, W) or (H, W, channels), perhaps with axes of length 1 around, and the EXR channel's
    name. Raises DepthFileError for an unknown suffix or an unusable file.
    """
    refuse_photo(path)
    suffix = path.suffix.lower()
    if suffix == ".exr":
        return read_exr(path, channel, check_size, channels)
    readers: dict[str, Callable[[Path, SizeCheck | None], NDArray[Any]]] = {
        ".npy": partial(_read_npy, channels=channels),
        ".pfm": read_pfm,
        ".png": _read_png,
        ".pgm": _read_pgm,
        ".tiff": _read_tiff,
        ".tif": _read_tiff,
    }
    if suffix not in readers:
        raise DepthFileError(
            f"{path.name} has no depth format", found=path.suffix, expected=", ".join(SUFFIXES)
        )
    return readers[suffix](path, check_size), None


def npz_contents(path: Path, labels: Container[str]) -> Npz:
    """Names of the arrays in an .npz, and its declarations; no image is read.

    DepthFileError if it is not an .npz, is damaged, or holds two arrays with one name.
    """
    refuse_photo(path)
    with _npz_errors(path), zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        names = [member.filename.removesuffix(".npy") for member in members]
        if len(set(names)) != len(names):
            raise ValueError("two arrays of one name")
        arrays, pictures = {}, []
        for name, member in zip(names, members, strict=True):
            if name in labels:
                arrays[name] = _label(path, archive, member)
                continue
            with _member(archive, member) as stream:
                shape, dtype = npy_claim(path, stream, member.file_size)
            if dtype.kind in "fiu" and len(shape) >= 2:
                pictures.append(name)
    return Npz(names=tuple(names), pictures=tuple(pictures), labels=arrays)


def read_npz_array(
    path: Path, name: str, check_size: SizeCheck | None, channels: int = 1
) -> NDArray[Any]:
    """(H, W), or (H, W, channels), of an .npz; its claimed size is checked before it is read.

    Axes of length 1 around are kept. Raises DepthFileError for a damaged file or another size.
    """
    with _npz_errors(path), zipfile.ZipFile(path) as archive:
        member = {m.filename.removesuffix(".npy"): m for m in archive.infolist()}[name]
        with _member(archive, member) as stream:
            shape, _ = npy_claim(path, stream, member.file_size)
        check_claim(path, shape, check_size, channels)
        with _member(archive, member) as stream:
            values = _plain_numbers(stream)
            if stream.read(1):
                raise ValueError(f"more bytes than the header of {name} says")
    return values


def npz_arrays(
    source: Path | IO[bytes], name: str, wanted: Container[str] | None = None
) -> dict[str, NDArray[Any]]:
    """Arrays of an .npz by name; what all of them claim is checked before any is read.

    Their shapes are as stored. wanted: None reads every array. name: of the file, for
    DepthFileError.
    """
    path = Path(name)
    with _npz_errors(path), zipfile.ZipFile(source) as archive:
        stems = {m: m.filename.removesuffix(".npy") for m in archive.infolist()}
        members = [m for m in stems if wanted is None or stems[m] in wanted]
        claimed = sum(member.file_size for member in members)
        if claimed > _MOST_BYTES:
            raise ValueError(f"{claimed:,} bytes of arrays, more than {_MOST_BYTES:,}")
        arrays = {}
        for member in members:
            with _member(archive, member) as stream:
                npy_claim(path, stream, member.file_size)
            with _member(archive, member) as stream:
                arrays[stems[member]] = _plain_numbers(stream)
    return arrays


def read_raw_float32(path: Path, size_wh: tuple[int, int]) -> NDArray[np.float32]:
    """ETH3D's depth: headerless little-endian float32, row major, as (H, W).

    DepthFileError if the file is a photo, or its size is not 4 * W * H bytes.
    """
    check_raw_float32(path, size_wh)
    values = np.fromfile(path, dtype="<f4").reshape(size_wh[1], size_wh[0])
    return values.astype(np.float32, copy=False)


def check_raw_float32(path: Path, size_wh: tuple[int, int]) -> None:
    """Check a raw depth file without reading it. DepthFileError for one of another size."""
    refuse_photo(path)
    width, height = size_wh
    expected, found = 4 * width * height, path.stat().st_size
    if found != expected:
        raise DepthFileError(
            f"{path.name} is not raw depth of this size",
            found=f"{found} bytes",
            expected=f"{expected} bytes = 4 x {width} x {height}",
            next_step="check the download, and cameras.txt for the size",
        )


def read_pfm(path: Path, check_size: SizeCheck | None = None) -> NDArray[np.float32]:
    """(H, W) of a one-channel PFM, either byte order, first row on top (its rows go upwards).

    Raises DepthFileError where the file's size is not that of its header.
    """
    shape, scale, place = pfm_claim(path)
    height, width = shape
    found = path.stat().st_size - place
    if found != 4 * width * height:
        raise DepthFileError(
            f"{path.name} does not have the size its header claims",
            found=f"{found} bytes of pixels",
            expected=f"{4 * width * height} = 4 x {width} x {height}",
        )
    check_claim(path, shape, check_size)
    kind = "<f4" if scale < 0 else ">f4"
    values = np.fromfile(path, kind, offset=place).reshape(shape)
    return np.ascontiguousarray(values[::-1]).astype(np.float32, copy=False)


def _read_npy(path: Path, check_size: SizeCheck | None, channels: int = 1) -> NDArray[Any]:
    with path.open("rb") as stream:
        shape, _ = npy_claim(path, stream, path.stat().st_size)
    check_claim(path, shape, check_size, channels)
    try:
        with path.open("rb") as stream:
            values = _plain_numbers(stream)
    except (OSError, ValueError, EOFError) as error:
        raise DepthFileError(
            f"{path.name} cannot be read", found=cause(error), expected="an .npy of plain numbers"
        ) from error
    return values


def _read_png(path: Path, check_size: SizeCheck | None) -> NDArray[Any]:
    check_claim(path, png_claim(path), check_size)
    return _decode_file(path, "a 16-bit PNG")


def _read_pgm(path: Path, check_size: SizeCheck | None) -> NDArray[Any]:
    check_claim(path, pgm_claim(path), check_size)
    return _decode_file(path, "a 16-bit PGM")


def _read_tiff(path: Path, check_size: SizeCheck | None) -> NDArray[Any]:
    check_claim(path, tiff_claim(path), check_size)
    return _decode_file(path, "a TIFF of floating-point numbers or 16-bit integers")


def _plain_numbers(stream: IO[bytes]) -> NDArray[Any]:
    values: NDArray[Any] = np.lib.format.read_array(  # type: ignore[no-untyped-call]
        stream, allow_pickle=False
    )
    return values


def _decode_file(path: Path, expected: str) -> NDArray[Any]:
    import cv2

    try:
        values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DepthFileError(
            f"{path.name} cannot be read", found=error.err, expected=expected
        ) from error
    if values is None:
        raise DepthFileError(f"{path.name} cannot be read", expected=expected)
    return values


def _member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> IO[bytes]:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member.filename} is compressed in a way that numpy does not write")
    return archive.open(member)


def _label(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    if member.file_size > _LABEL_BYTES:
        raise ValueError(f"{member.filename} has {member.file_size} bytes and is no label")
    with _member(archive, member) as stream:
        npy_claim(path, stream, member.file_size)
    with _member(archive, member) as stream:
        return _plain_numbers(stream)


@contextmanager
def _npz_errors(path: Path) -> Iterator[None]:
    """Convert the exceptions of zipfile, zlib and NumPy for a damaged .npz to one error."""
    try:
        yield
    except (
        OSError,
        ValueError,
        EOFError,
        RuntimeError,  # encrypted, or a compression method zipfile does not know
        KeyError,
        zipfile.BadZipFile,
        zlib.error,
    ) as error:
        raise DepthFileError(
            f"{path.name} cannot be read",
            found=cause(error),
            expected="an .npz of plain arrays",
        ) from error
