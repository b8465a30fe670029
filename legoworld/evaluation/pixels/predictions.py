"""The predictions of a run: each image's file, and its array or the reason for its lack."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from legoworld.depth_files.headers import SizeCheck
from legoworld.evaluation.pixels.family import PixelArray, PixelFamily
from legoworld.evaluation.run import Run, read_family_run, read_rows
from legoworld.files import names_a_file, sha256_of_file
from legoworld.readouts.pixels import PixelFile
from legoworld.records.run_rows import RunImage, RunRow


@dataclass(frozen=True, kw_only=True)
class PixelImage:
    """One attempted image. path: of its file, which may be missing.

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
class PixelRun:
    """A finished run. kind: "scene", or the other source of the predictions."""

    run: Run
    kind: str
    images: tuple[PixelImage, ...]


def read_pixel_run(folder: Path, family: PixelFamily) -> PixelRun:
    """A family's run and its images by ascending id. Raises RunUnusableError or UsageError."""
    run = read_family_run(folder, family.family, f"a {family.noun} run")
    return PixelRun(
        run=run,
        kind=str(run.configuration.kind or None),
        images=tuple(_image(folder, row, family.stored) for row in read_rows(run)),
    )


def load_prediction(
    image: PixelImage, family: PixelFamily, check_size: SizeCheck | None = None
) -> PixelArray:
    """The image's prediction. check_size: called with the claimed size before it is read.

    The family's errors: `missing` if there is no file; `prediction` or DepthFileError for an
    unusable one: its bytes differ from the recorded hash, its quantity is undeclared, or its size
    is not the rendered one.
    """
    noun, errors = family.noun, family.errors
    if not names_a_file(image.path):
        raise errors.missing(
            f"there is no {noun} file", found="nothing", expected=family.stored.path(image.stem)
        )
    if image.sha256 is not None and sha256_of_file(image.path) != image.sha256:
        raise errors.prediction(
            f"the {noun} file is not the one the run wrote",
            found="another sha256",
            expected=image.sha256,
            next_step="run the readout again",
        )
    array = family.read(image.path, check_size)
    if image.rendered_wh is not None and array.size_wh != image.rendered_wh:
        raise errors.prediction(
            f"the {noun} file is not of the size the run recorded",
            found="{}x{}".format(*array.size_wh),
            expected="{}x{}".format(*image.rendered_wh),
        )
    return array


def photo_stem(file_name: str) -> str:
    """A photo's path without its extension, "/"-separated: the stem of its file."""
    return str(PurePosixPath(file_name).with_suffix(""))


def _image(folder: Path, row: RunRow, stored: PixelFile) -> PixelImage:
    recorded = row.depth or row.normals or row.answer or None
    file = recorded.file if recorded else stored.path(photo_stem(row.file_name))
    return PixelImage(
        image=row,
        path=folder / file,
        reason=row.reason,
        sha256=(recorded.sha256 or None) if recorded else None,
        rendered_wh=row.rendered_wh or None,
    )
