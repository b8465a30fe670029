"""Normals of others as runs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from msgspec.structs import replace

from legoworld.baselines.baseline_import import ImportRequest
from legoworld.baselines.depth import NAMING as DEPTH_NAMING
from legoworld.baselines.depth import declared_depth, imported_depth
from legoworld.baselines.depth_normals import fit_normals
from legoworld.baselines.family import BaselineFamily, ImportListener, ImportOptions
from legoworld.baselines.pixel_import import PixelSource, import_pixels
from legoworld.baselines.pixel_matching import Naming
from legoworld.errors import UsageError
from legoworld.evaluation.normals.arrays import (
    VALUES,
    Declaration,
    NormalsArray,
    NormalsPredictionError,
    read_normals,
    read_prediction,
    valid_normals,
)
from legoworld.evaluation.normals.family import PIXELS
from legoworld.evaluation.pixels.resampling import size_check
from legoworld.files import sha256_of_file, write_npz
from legoworld.readouts.normals import NORMALS_FILE
from legoworld.records.run_file import ImageRecord, ImageSource, Imported
from legoworld.records.run_rows import NormalsFile
from legoworld.running.image_record import initial_row
from legoworld.running.readout_run import RunResult
from legoworld.tracks.track import TrackImage

NAMING: Final = Naming(
    noun="normals",
    endings=("_normal", "-normal", "_normals", "-normals", "_norm", "_pred", "-pred"),
)


def normals_source(folder: Path, options: ImportOptions) -> PixelSource:
    """A folder of arrays of normals, or of depth, by the options of its import.

    UsageError for a depth with a sign, or intrinsics of normals.
    """
    naming, imported, read = (
        _of_normals(folder, options) if options.get("space") is None else _of_depth(folder, options)
    )
    return PixelSource(
        folder=folder,
        suffix=options.get("suffix"),
        naming=naming,
        imported=imported,
        stored=NORMALS_FILE,
        read=read,
        write=_write,
        record=_record,
    )


#: How the files are named, what the run says of them, and how one is read.
_Source = tuple[Naming, Imported, Callable[[Path, TrackImage], NormalsArray]]


def _of_normals(folder: Path, options: ImportOptions) -> _Source:
    if other := [name for name in ("unit", "intrinsics") if options.get(name) is not None]:
        raise UsageError(
            f"--{other[0]} is for depth that normals are fitted to",
            found="no --space",
            expected="--space depth, disparity or ray_distance",
        )
    declared = Declaration(sign=options.get("sign"), array=options.get("array"))
    imported = Imported(
        folder=folder.resolve().name,
        sign=declared.sign,
        array=declared.array,
        suffix=options.get("suffix"),
    )
    return NAMING, imported, partial(_read, declared)


def _of_depth(folder: Path, options: ImportOptions) -> _Source:
    if options.get("sign") is not None:
        raise UsageError(
            "normals that are fitted to depth point towards the camera",
            found="--sign and --space",
            expected="--sign for normals, or --space for depth",
        )
    declared = declared_depth(options)
    return (
        DEPTH_NAMING,
        imported_depth(folder, declared, options),
        lambda path, image: _with_normals(fit_normals(declared, path, image)),
    )


def _read(declaration: Declaration, path: Path, image: TrackImage) -> NormalsArray:
    """A photo's array after all checks that need no ground truth."""
    assert image.size_wh is not None
    check = size_check(PIXELS, image.size_wh)
    array = read_normals(path, declaration, check)
    check(array.size_wh)
    return _with_normals(array)


def _with_normals(array: NormalsArray) -> NormalsArray:
    if not valid_normals(array.values).any():
        raise NormalsPredictionError(
            "the array has no normal at any pixel",
            found="no finite vector longer than 0.5",
            expected="unit vectors",
        )
    return array


def _write(path: Path, array: NormalsArray) -> None:
    write_npz(path, {VALUES: array.values, "sign": np.array(array.sign)})


def _record(image: TrackImage, run: Path, source: ImageSource) -> ImageRecord:
    """The record of one image's file in the run, read back."""
    name = NORMALS_FILE.path(image.scene)
    array = read_prediction(run / name, None)
    file = NormalsFile(
        file=name,
        sha256=sha256_of_file(run / name),
        bytes=(run / name).stat().st_size,
        sign=array.sign,
        finite_px=int(valid_normals(array.values).sum()),
    )
    row = replace(initial_row(image), rendered_wh=array.size_wh, normals=file)
    return ImageRecord(row=row, scene=source)


def _import(
    request: ImportRequest, source: Path, options: ImportOptions, telling: ImportListener
) -> RunResult:
    telling.total(len(request.track.images))
    answers = normals_source(source, options)
    return import_pixels(request, answers, progress=telling.progress, notice=telling.notice)


BASELINE: Final = BaselineFamily(
    of_folder=True,
    what="a folder of arrays of normals, or of depth with --space",
    options=frozenset({"sign", "array", "suffix", "space", "unit", "intrinsics"}),
    import_answers=_import,
    own_file=lambda row: NORMALS_FILE.path(row.scene),
)
