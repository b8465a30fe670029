"""Arrays of normals from files, with the sign that they state; those of ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import SizeCheck
from legoworld.depth_files.read_depth import npz_contents, read_npz_array, read_picture
from legoworld.evaluation.pixels.family import (
    F64,
    Index,
    Mask,
    PixelArray,
    PixelTruth,
    Stored,
    TruthFile,
    pixel_errors,
)
from legoworld.evaluation.pixels.labelled import (
    check_version,
    find_all_truth,
    find_array,
    fits_into_memory,
    is_text,
    merge_declarations,
    picture_name,
    read_declared,
    text_label,
)
from legoworld.readouts.normals import NORMALS_FILE
from legoworld.records.run_rows import RunImage

NormalsTruthError, NormalsPredictionError, NormalsMissingError, NormalsUnseenError = ERRORS = (
    pixel_errors("normals", __name__)
)


DECLARATION: Final = "normals.toml"
TOWARDS: Final = NORMALS_FILE.labels["sign"]
SIGNS: Final = (TOWARDS, "away_from_camera")
VALUES: Final = "values"
_SUFFIXES: Final = (".npz", ".npy", ".exr", ".png")
_LABELS: Final = ("sign", "format_version")
_SHORTEST: Final = 0.5


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """What is declared of files that do not say it. sign: of `SIGNS`; array: name in an .npz."""

    sign: str | None = None
    array: str | None = None


@dataclass(frozen=True, kw_only=True)
class NormalsArray(PixelArray):
    """(H, W, 3) float32 or float64 vectors of any length, in the OpenCV camera frame.

    sign: of `SIGNS`; a frontal wall is (0, 0, -1) towards the camera, (0, 0, 1) away from it.
    """

    sign: str

    def at(self, rows: Index, cols: Index) -> tuple[F64, Mask]:
        """Unit vectors towards the camera at pixels (n,), 0 where there is none, and their mask."""
        values = self.values[rows, cols]
        known = valid_normals(values)
        unit = unit_vectors(np.where(known[:, None], values, 0.0))
        return (unit if self.sign == TOWARDS else -unit), known


def valid_normals(values: NDArray[Any]) -> Mask:
    """Mask of the finite vectors longer than 0.5; values: (..., 3)."""
    with np.errstate(invalid="ignore", over="ignore"):
        squares = np.square(values).sum(axis=-1)
    known: Mask = (squares > _SHORTEST * _SHORTEST) & np.isfinite(squares)
    return known


def unit_vectors(values: NDArray[Any]) -> F64:
    """(n, 3) vectors in float64 at length 1; a vector of length 0 stays."""
    wide = values.astype(np.float64)
    lengths = np.sqrt(np.square(wide).sum(axis=1, keepdims=True))
    unit: F64 = np.divide(wide, lengths, out=np.zeros_like(wide), where=lengths > 0)
    return unit


def read_declaration(folder: Path) -> Declaration:
    """The folder's normals.toml; an empty declaration without one. NormalsTruthError if invalid."""
    values = read_declared(
        folder / DECLARATION,
        {"sign": lambda value: value in SIGNS, "array": is_text},
        expected=f"sign = {' | '.join(SIGNS)}, and array, a name inside the .npz files",
        error=NormalsTruthError,
    )
    return Declaration(**values)


def read_normals(
    path: Path, declared: Declaration, check_size: SizeCheck | None = None
) -> NormalsArray:
    """An .npz, .npy, .exr or 8- or 16-bit PNG of normals. DepthFileError if it is unusable.

    The sign is the .npz file's own text `sign`, else the declared one; without either the file is
    refused. A PNG holds (n + 1) / 2 of its range in the channels red, green, blue, and 0, 0, 0
    where nothing is known.
    """
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise DepthFileError(
            f"{path.name} is no file of normals", found=suffix, expected=" or ".join(_SUFFIXES)
        )
    sign, name = declared.sign, None
    with fits_into_memory(path):
        if suffix == ".npz":
            contents = npz_contents(path, _LABELS)
            candidates = (declared.array,) if declared.array else (NORMALS_FILE.array, VALUES)
            name = picture_name(path, contents, candidates, "normals", DECLARATION)
            check_version(contents.labels, path, NORMALS_FILE.version)
            sign = merge_declarations("sign", text_label(contents.labels, "sign", path), sign, path)
            values = read_npz_array(path, name, check_size, channels=3)
        else:
            values, name = read_picture(path, check_size=check_size, channels=3)
        stored = Stored(array=name, dtype=str(values.dtype), shape=values.shape)
        values = _vectors(values, path)
    if sign not in SIGNS:
        raise DepthFileError(
            f"{path.name} does not say which way its normals point",
            found=f"sign {sign!r}",
            expected=" | ".join(SIGNS),
            next_step=f"state sign in {DECLARATION}, or --sign of an import: a frontal wall is "
            "(0, 0, -1) towards the camera, (0, 0, 1) away from it",
        )
    return NormalsArray(values=values, sign=sign, stored=stored)


def read_prediction(path: Path, check_size: SizeCheck | None) -> NormalsArray:
    """A file of a run, which states its sign. The same errors."""
    return read_normals(path, Declaration(), check_size)


def _vectors(values: NDArray[Any], path: Path) -> NDArray[Any]:
    if values.ndim == 4 and values.shape[0] == 1:
        values = values[0]
    integers = path.suffix.lower() == ".png" and values.dtype in (np.uint8, np.uint16)
    floats = values.dtype.kind == "f" and values.dtype.itemsize in (4, 8)
    if values.ndim != 3 or values.shape[2] != 3 or not (integers or floats):
        raise DepthFileError(
            f"{path.name} is not one array of normals",
            found=f"{values.dtype}, shape {values.shape}",
            expected="(height, width, 3) float32 or float64, or a PNG of three channels",
        )
    if not integers:
        return values.astype(values.dtype.newbyteorder("="), copy=False)
    vectors = values[..., ::-1].astype(np.float32)  # OpenCV has blue first
    vectors *= 2.0 / np.iinfo(values.dtype).max
    vectors -= 1.0
    vectors[~values.any(axis=2)] = np.nan
    return vectors


@dataclass(frozen=True, kw_only=True)
class NormalsTruthFile(TruthFile):
    """One image's ground truth; normals need no further files."""

    declared: Declaration


def file_stems(photo: str) -> tuple[str, ...]:
    """What the normals of a photo may be called: X_normal beside X_img or X, or its own name.

    The first are those of DSINE's evaluation sets and of DIODE, which keep them beside the photos.
    """
    return f"{photo.removesuffix('_img')}_normal", f"{photo}_normal", photo


def find_truth(truth: Path, images: Sequence[RunImage]) -> tuple[NormalsTruthFile, ...]:
    """The ground truth of every image, in image order. NormalsTruthError where one has none."""
    declared = read_declaration(truth)

    def find(image: RunImage) -> NormalsTruthFile | None:
        path = find_array(truth, image, noun="normals", error=NormalsTruthError, stems=file_stems)
        return NormalsTruthFile(path=path, declared=declared) if path else None

    return find_all_truth(
        truth, images, find, noun="normals", layout="a folder of arrays", error=NormalsTruthError
    )


def load_truth(file: NormalsTruthFile) -> PixelTruth:
    """Read one ground truth; its vectors are turned towards the camera."""
    array = read_normals(file.path, file.declared)
    values = array.values
    return PixelTruth(values=values if array.sign == TOWARDS else np.negative(values), counts={})
