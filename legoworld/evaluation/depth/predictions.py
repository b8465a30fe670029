"""The predictions of a depth run: each image's file, and its array or the reason for its lack."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from legoworld.depth_files.headers import SizeCheck
from legoworld.evaluation.depth.arrays import DepthArray
from legoworld.evaluation.depth.declaration import Declaration
from legoworld.evaluation.depth.errors import DepthMissingError, DepthPredictionError
from legoworld.evaluation.depth.labelled import read_labelled
from legoworld.evaluation.run import Run, read_rows, read_run_of
from legoworld.files import names_a_file, sha256_of_file
from legoworld.readouts.depth import depth_file
from legoworld.records.run_rows import RunImage, RunRow
from legoworld.tasks.shipped import DEPTH


@dataclass(frozen=True, kw_only=True)
class DepthImage:
    """One attempted image. path: of its depth file, which may be missing.

    reason: why the run has no prediction, None if it has one. sha256, rendered_wh: as recorded by
    the run, or None.
    """

    image: RunImage
    path: Path
    reason: str | None
    sha256: str | None
    rendered_wh: tuple[int, int] | None

    @property
    def stem(self) -> str:
        """The photo's path without its extension, "/"-separated."""
        return photo_stem(self.image.file_name)


@dataclass(frozen=True, kw_only=True)
class DepthRun:
    """A finished depth run. kind: "scene", or the other source of the predictions."""

    run: Run
    kind: str
    images: tuple[DepthImage, ...]


def read_depth_run(folder: Path) -> DepthRun:
    """A depth run and its images by ascending id. Raises RunUnusableError or UsageError."""
    run = read_run_of(folder, DEPTH, "a depth run")
    return DepthRun(
        run=run,
        kind=str(run.configuration.kind or None),
        images=tuple(_depth_image(folder, row) for row in read_rows(run)),
    )


def load_prediction(image: DepthImage, check_size: SizeCheck | None = None) -> DepthArray:
    """The image's prediction. check_size: called with the claimed size before it is read.

    DepthMissingError if there is no file; DepthPredictionError or DepthFileError for an unusable
    file: its bytes differ from the recorded hash, its quantity is undeclared, or its size is not
    the rendered one.
    """
    if not names_a_file(image.path):
        raise DepthMissingError(
            "there is no depth file", found="nothing", expected=depth_file(image.stem)
        )
    if image.sha256 is not None and sha256_of_file(image.path) != image.sha256:
        raise DepthPredictionError(
            "the depth file is not the one the run wrote",
            found="another sha256",
            expected=image.sha256,
            next_step="run the readout again",
        )
    array = read_labelled(image.path, Declaration(), check_size=check_size)
    if image.rendered_wh is not None and array.size_wh != image.rendered_wh:
        raise DepthPredictionError(
            "the depth file is not of the size the run recorded",
            found="{}x{}".format(*array.size_wh),
            expected="{}x{}".format(*image.rendered_wh),
        )
    return array


def photo_stem(file_name: str) -> str:
    """A photo's path without its extension, "/"-separated: the stem of its depth file."""
    return str(PurePosixPath(file_name).with_suffix(""))


def _depth_image(folder: Path, row: RunRow) -> DepthImage:
    recorded = row.depth or None
    file = recorded.file if recorded else depth_file(photo_stem(row.file_name))
    return DepthImage(
        image=row,
        path=folder / file,
        reason=row.reason,
        sha256=(recorded.sha256 or None) if recorded else None,
        rendered_wh=row.rendered_wh or None,
    )
