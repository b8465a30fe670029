"""The ground truth of a run's images: arrays of normals named like the photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from legoworld.evaluation.normals.arrays import (
    TOWARDS,
    Declaration,
    read_declaration,
    read_normals,
)
from legoworld.evaluation.normals.errors import NormalsTruthError
from legoworld.evaluation.pixels.family import PixelTruth
from legoworld.evaluation.pixels.truth import array_of, truth_of_all
from legoworld.records.run_rows import RunImage


@dataclass(frozen=True, kw_only=True)
class NormalsTruthFile:
    """One image's ground truth. calibration: normals need no further files."""

    path: Path
    declared: Declaration
    calibration: tuple[Path, ...] = ()


def file_stems(photo: str) -> tuple[str, ...]:
    """What the normals of a photo may be called: X_normal beside X_img or X, or its own name.

    The first are those of DSINE's evaluation sets and of DIODE, which keep them beside the photos.
    """
    return f"{photo.removesuffix('_img')}_normal", f"{photo}_normal", photo


def find_truth(truth: Path, images: Sequence[RunImage]) -> tuple[NormalsTruthFile, ...]:
    """The ground truth of every image, in image order. NormalsTruthError where one has none."""
    declared = read_declaration(truth)

    def find(image: RunImage) -> NormalsTruthFile | None:
        path = array_of(truth, image, noun="normals", error=NormalsTruthError, stems=file_stems)
        return NormalsTruthFile(path=path, declared=declared) if path else None

    return truth_of_all(
        truth, images, find, noun="normals", layout="a folder of arrays", error=NormalsTruthError
    )


def load_truth(file: NormalsTruthFile) -> PixelTruth:
    """Read one ground truth; its vectors are turned towards the camera."""
    array = read_normals(file.path, file.declared)
    values = array.values
    return PixelTruth(values=values if array.sign == TOWARDS else np.negative(values), counts={})
