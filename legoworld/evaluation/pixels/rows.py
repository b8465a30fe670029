"""The row of one image: its file, its status, and its numbers as the family measures them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

from msgspec.structs import replace
from numpy.typing import NDArray

from legoworld.cards import load_card
from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import SizeCheck
from legoworld.evaluation.pixels.family import (
    ImageResult,
    Measuring,
    Options,
    PixelArray,
    PixelFamily,
    PixelTruth,
    TruthFile,
)
from legoworld.evaluation.pixels.resampling import size_check
from legoworld.evaluation.run import Run, read_family_run, read_rows
from legoworld.files import names_a_file, sha256_of_file
from legoworld.readouts.pixels import PixelFile
from legoworld.records.pixels import NO_TRUTH, PixelRow
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
    return pixel_run(read_family_run(folder, family.family, f"a {family.noun} run"), family)


def pixel_run(run: Run, family: PixelFamily) -> PixelRun:
    """A run with its images by ascending id. RunUnusableError."""
    return PixelRun(
        run=run,
        kind=str(run.configuration.kind or None),
        images=tuple(_image(run.folder, row, family.stored) for row in read_rows(run)),
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


R = TypeVar("R", bound=PixelRow)


def score_row(
    image: PixelImage, file: TruthFile, family: PixelFamily, task: str, options: Options
) -> ImageResult:
    """Score one image; both arrays are read here and freed on return.

    Errors of the prediction become the row's status and reason; errors of the ground truth are
    raised.
    """
    truth = _load_truth(file, family)
    row = _truth_row(image.image, truth, family)

    def load(check: SizeCheck) -> PixelArray:
        return load_prediction(image, family, check)

    if row.n_valid >= family.protocol(load_card(task)).min_valid_px and image.image.status != "ok":
        return ImageResult(row=replace(row, status=image.image.status, reason=image.reason))
    return _measure_image(row, truth, file, load, family, task, options)


def score_values(
    image: RunImage, values: NDArray[Any], truth: PixelTruth, family: PixelFamily, task: str
) -> ImageResult:
    """Score one image of arrays in memory, `score_row`. values: (H, W), or (H, W, 3) of normals."""
    row, options = _truth_row(image, truth, family), family.options
    return _measure_image(row, truth, None, lambda _: family.array(values), family, task, options)


def _measure_image(
    row: PixelRow,
    truth: PixelTruth,
    file: TruthFile | None,
    load: Callable[[SizeCheck], PixelArray],
    family: PixelFamily,
    task: str,
    options: Options,
) -> ImageResult:
    protocol = family.protocol(load_card(task))
    needed = protocol.min_valid_px
    if row.n_valid < needed:
        reason = f"{row.n_valid} valid truth pixels, {needed} are needed"
        return ImageResult(row=replace(row, status=NO_TRUTH, reason=reason))
    try:
        check = size_check(family, truth.size_wh)
        prediction = load(check)
        check(prediction.size_wh)
        read = replace(
            row, prediction_wh=prediction.size_wh, resampled=prediction.size_wh != truth.size_wh
        )
        return family.measure(
            Measuring(
                row=read,
                prediction=prediction,
                truth=truth,
                file=file,
                protocol=protocol,
                options=options,
            )
        )
    except (family.errors.missing, family.errors.prediction, DepthFileError) as error:
        row = replace(row, status=error.status, code=error.code, reason=str(error))
    except MemoryError:
        reason = "there is not enough memory to score it: use fewer workers"
        row = replace(row, status="invalid", code="memory", reason=reason)
    return ImageResult(row=row)


def _load_truth(file: TruthFile, family: PixelFamily) -> PixelTruth:
    try:
        return family.load_truth(file)
    except MemoryError as error:
        raise family.errors.truth(
            f"the ground truth {file.path.name} does not fit into memory",
            found=f"a file of {file.path.stat().st_size} bytes",
            expected="an array that this process can hold",
            next_step="use fewer workers",
        ) from error


def _truth_row(image: RunImage, truth: PixelTruth, family: PixelFamily) -> PixelRow:
    step = max(1, (1 << 20) // truth.size_wh[0])
    starts = range(0, truth.size_wh[1], step)
    name = image.file_name
    return family.row(
        image_id=image.image_id,
        file_name=name,
        group=family.group(name),
        status="",
        code=None,
        reason=None,
        run_status=image.status,
        truth_wh=truth.size_wh,
        n_valid=sum(int(family.valid(truth.values[i : i + step]).sum()) for i in starts),
        warnings=truth.warnings,
        **truth.counts,
    )


def with_holes(row: R, n_predicted: int) -> R:
    """A row with the number of valid pixels that have a prediction, and the share without."""
    return replace(row, n_predicted=n_predicted, hole_share=1.0 - n_predicted / row.n_valid)


def too_few(row: PixelRow, n_predicted: int, needed: int) -> ImageResult:
    """A row whose prediction has too few pixels to be scored."""
    reason = (
        f"{n_predicted} of {row.n_valid} valid truth pixels have a prediction, {needed} are needed"
    )
    return ImageResult(row=replace(row, status="invalid", code="too_few_pixels", reason=reason))
