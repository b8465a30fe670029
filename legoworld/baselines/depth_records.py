"""Records of a baseline's depth: each image's file, read back and checked as in scoring."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from legoworld.baselines.records import AnswerInvalidError, AnswerRules
from legoworld.evaluation.depth.arrays import DepthArray, DepthPredictionError
from legoworld.evaluation.depth.family import PIXELS
from legoworld.evaluation.depth.labelled import read_prediction
from legoworld.evaluation.pixels.resampling import size_check
from legoworld.files import sha256_of_file
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.base import UNSET, canonical
from legoworld.records.baseline_messages import DepthSaid, Message
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.records.run_rows import DepthFile, RunRow
from legoworld.running.image_record import initial_row
from legoworld.tracks.track import TrackImage


def answered_depth(
    image: TrackImage, answer: Message, rules: AnswerRules, source: ImageSource
) -> ImageRecord:
    """A child's answer as a record. LegoWorldError for a file that `evaluate` would refuse."""
    record = depth_record(image, rules.run, source)
    _check_depth_answer(answer.depth, record.row)
    return record


def depth_record(image: TrackImage, run: Path, source: ImageSource) -> ImageRecord:
    """The record of one image's depth file in the run, read back and checked.

    LegoWorldError if it is missing, undeclared, or cannot be scored.
    """
    name = DEPTH_FILE.path(image.scene)
    path = run / name
    if not path.is_file():
        raise AnswerInvalidError("the depth file was not written", expected=name)
    assert image.size_wh is not None
    array = read_prediction(path, size_check(PIXELS, image.size_wh))
    depth = DepthFile(
        file=name,
        space=array.space,
        unit=array.unit,
        bytes=path.stat().st_size,
        sha256=sha256_of_file(path),
        finite_px=predicted_px(array, image),
    )
    row = replace(initial_row(image), rendered_wh=array.size_wh, depth=depth)
    return ImageRecord(row=row, scene=source)


def predicted_px(array: DepthArray, image: TrackImage) -> int:
    """The number of pixels with a prediction, as in scoring (`DepthArray.at`).

    DepthPredictionError for an array that cannot be scored: of the wrong size, or without a
    prediction at any pixel.
    """
    assert image.size_wh is not None
    size_check(PIXELS, image.size_wh)(array.size_wh)
    predicted = array.prediction_mask(array.values)
    if not predicted.any():
        raise DepthPredictionError(
            "the depth has no prediction at any pixel",
            found="no finite number" + ("" if array.space == "disparity" else " above 0"),
            expected="finite numbers" + ("" if array.space == "disparity" else " above 0"),
        )
    return int(predicted.sum())


def _check_depth_answer(said: DepthSaid | None, row: RunRow) -> None:
    """Check that the written file is the one the child reported."""
    assert row.depth
    assert row.rendered_wh
    answered = DepthSaid(
        sha256=row.depth.sha256 or "",
        size_wh=row.rendered_wh,
        space=row.depth.space or "",
        unit=None if row.depth.unit is UNSET else row.depth.unit,
    )
    if said != answered:
        raise AnswerInvalidError(
            "the depth file is not the one the baseline spoke of",
            found=canonical(answered),
            expected=canonical(said) if said else "a word about the file",
        )
