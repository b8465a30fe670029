"""Records of a baseline's run: each image's answer, checked as `evaluate` would check it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from legoworld.errors import LegoWorldError
from legoworld.evaluation.depth.arrays import DepthArray
from legoworld.evaluation.depth.declaration import Declaration
from legoworld.evaluation.depth.errors import DepthPredictionError
from legoworld.evaluation.depth.family import PIXELS
from legoworld.evaluation.depth.labelled import read_labelled
from legoworld.evaluation.detection.inputs.box_formats import check_box_values
from legoworld.evaluation.detection.inputs.prediction_checks import as_predictions
from legoworld.evaluation.detection.inputs.predictions import Predictions, check_results, kind_of
from legoworld.evaluation.detection.protocols import DetectionProtocol
from legoworld.evaluation.pixels.resampling import size_check
from legoworld.files import sha256_of_file
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.base import UNSET, as_json, canonical
from legoworld.records.baseline_messages import DepthSaid, Message
from legoworld.records.folders.prediction_files import has_its_results, predictions_sha256
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.records.run_rows import DepthFile, RunRow
from legoworld.running.image_record import failed_record, row_of
from legoworld.tracks.track import TrackImage
from legoworld.tracks.vocabulary import Vocabulary


class ImageFailedError(LegoWorldError):
    """The baseline has no result for an image and reported the reason."""

    code = "baseline_image"


class AnswerInvalidError(LegoWorldError):
    """A baseline's result is invalid."""

    code = "baseline_answer"


class PhotoMissingError(LegoWorldError):
    """An image of the track has no photo."""

    code = "missing_photo"
    status = "missing"


class ResultMissingError(LegoWorldError):
    """The imported results do not cover an image of the track."""

    code = "missing_result"
    status = "missing"


class ImageCrashedError(LegoWorldError):
    """The baseline's process crashed at every attempt at an image."""

    code = "baseline_crashed"


class ImageTimeoutError(LegoWorldError):
    """The baseline did not finish an image within the time limit."""

    code = "baseline_timeout"
    status = "timeout"


@dataclass(frozen=True, kw_only=True)
class AnswerRules:
    """The rules for checking an image's answer. protocol, vocabulary: None for depth."""

    run: Path
    protocol: DetectionProtocol | None
    vocabulary: Vocabulary | None


def answered_record(
    image: TrackImage, answer: Message, rules: AnswerRules, source: ImageSource
) -> ImageRecord:
    """A child's answer as a record; one that `evaluate` would refuse fails that image."""
    try:
        if answer.failed is not None:
            raise ImageFailedError(answer.failed)
        if rules.protocol is None:
            record = depth_record(image, rules.run, source)
            _check_depth_answer(answer.depth, record.row)
        else:
            record = detection_record(image, _checked(image, answer, rules), source)
    except LegoWorldError as error:
        return failed_record(image, error)
    return replace(record, row=replace(record.row, counts=answer.counts or {}))


def detection_record(
    image: TrackImage, predictions: Predictions, source: ImageSource
) -> ImageRecord:
    """The record of one image's checked boxes or masks. source: its run.json entry."""
    entries = tuple(predictions.entries)
    row = replace(
        row_of(image),
        n_predictions=len(entries),
        predictions_sha256=predictions_sha256(entries),
        empty_masks_dropped=predictions.n_dropped_empty,
        warnings=tuple(predictions.warnings),
    )
    return ImageRecord(row=row, predictions=entries, scene=source)


def depth_record(image: TrackImage, run: Path, source: ImageSource) -> ImageRecord:
    """The record of one image's depth file in the run, read back and checked.

    LegoWorldError if it is missing, undeclared, or cannot be scored.
    """
    name = DEPTH_FILE.path(image.scene)
    path = run / name
    if not path.is_file():
        raise AnswerInvalidError("the depth file was not written", expected=name)
    assert image.size_wh is not None
    check = size_check(PIXELS, image.size_wh)
    array = read_labelled(path, Declaration(), check_size=check)
    depth = DepthFile(
        file=name,
        space=array.space,
        unit=array.unit,
        bytes=path.stat().st_size,
        sha256=sha256_of_file(path),
        finite_px=predicted_px(array, image),
    )
    row = replace(row_of(image), rendered_wh=array.size_wh, depth=depth)
    return ImageRecord(row=row, scene=source)


def predicted_px(array: DepthArray, image: TrackImage) -> int:
    """The number of pixels with a prediction, as in scoring (`DepthArray.at`).

    DepthPredictionError for an array that cannot be scored: of the wrong size, or without a
    prediction at any pixel.
    """
    assert image.size_wh is not None
    size_check(PIXELS, image.size_wh)(array.size_wh)
    predicted = array.predicted(array.values)
    if not predicted.any():
        raise DepthPredictionError(
            "the depth has no prediction at any pixel",
            found="no finite number" + ("" if array.space == "disparity" else " above 0"),
            expected="finite numbers" + ("" if array.space == "disparity" else " above 0"),
        )
    return int(predicted.sum())


def is_intact(record: ImageRecord, run: Path, source: ImageSource) -> bool:
    """Whether a stored record is a complete result of the same source (by its hashes)."""
    if record.row.status != "ok" or record.scene is None:
        return False
    stored = as_json(record.scene)
    if any(stored.get(key) != value for key, value in as_json(source).items()):
        return False
    return has_its_results(record, run)


def _checked(image: TrackImage, answer: Message, rules: AnswerRules) -> Predictions:
    if answer.predictions is None:
        raise AnswerInvalidError(
            "the baseline gave no predictions",
            found="an answer without them",
            expected='"predictions", a list',
        )
    assert rules.protocol is not None
    assert rules.vocabulary is not None
    assert image.size_wh is not None
    return check_results(
        [as_predictions(answer.predictions, kind_of(rules.protocol))],
        status_by_image={image.id: "ok"},
        sizes_wh={image.id: image.size_wh},
        vocabulary=rules.vocabulary,
        protocol=rules.protocol,
        order="given",
        check_boxes=check_box_values,
    )


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
