"""The row of one image: its status, its coverage, and its numbers as the family measures them."""

from __future__ import annotations

from collections.abc import Callable
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
from legoworld.evaluation.pixels.predictions import PixelImage, load_prediction
from legoworld.evaluation.pixels.resampling import size_check
from legoworld.records.pixels import NO_TRUTH, PixelRow
from legoworld.records.run_rows import RunImage

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
    image: RunImage,
    values: NDArray[Any],
    truth: PixelTruth,
    family: PixelFamily,
    task: str,
    options: Options,
) -> ImageResult:
    """Score one image of arrays in memory, `score_row`. values: (H, W), or (H, W, 3) of normals."""
    row = _truth_row(image, truth, family)
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
