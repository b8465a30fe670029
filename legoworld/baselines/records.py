"""Records of a baseline's run: each image's answer, checked as `evaluate` would check it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from legoworld.baselines.family import load_baseline_family
from legoworld.errors import LegoWorldError
from legoworld.evaluation.detection.inputs.box_formats import check_box_values
from legoworld.evaluation.detection.inputs.prediction_checks import as_predictions
from legoworld.evaluation.detection.inputs.predictions import (
    Predictions,
    check_results,
    prediction_type,
)
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.records.base import as_json
from legoworld.records.baseline_messages import Message
from legoworld.records.folders.prediction_files import has_its_results, predictions_sha256
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.running.image_record import failed_record, initial_row
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
    """The rules for checking an image's answer. vocabulary: None where it has no categories."""

    run: Path
    task: str
    vocabulary: Vocabulary | None


def answered_record(
    image: TrackImage, answer: Message, rules: AnswerRules, source: ImageSource
) -> ImageRecord:
    """A child's answer as a record; one that `evaluate` would refuse fails that image."""
    try:
        if answer.failed is not None:
            raise ImageFailedError(answer.failed)
        answered = load_baseline_family(rules.task).answered
        if answered is None:
            raise AnswerInvalidError(f"a baseline's process cannot answer {rules.task}")
        record = answered(image, answer, rules, source)
    except LegoWorldError as error:
        return failed_record(image, error)
    return replace(record, row=replace(record.row, counts=answer.counts or {}))


def answered_detections(
    image: TrackImage, answer: Message, rules: AnswerRules, source: ImageSource
) -> ImageRecord:
    """A child's boxes or masks as a record. LegoWorldError for what `evaluate` would refuse."""
    return detection_record(image, _check_predictions(image, answer, rules), source)


def detection_record(
    image: TrackImage, predictions: Predictions, source: ImageSource
) -> ImageRecord:
    """The record of one image's checked boxes or masks. source: its run.json entry."""
    entries = tuple(predictions.entries)
    row = replace(
        initial_row(image),
        n_predictions=len(entries),
        predictions_sha256=predictions_sha256(entries),
        empty_masks_dropped=predictions.n_dropped_empty,
        warnings=tuple(predictions.warnings),
    )
    return ImageRecord(row=row, predictions=entries, scene=source)


def is_intact(record: ImageRecord, run: Path, source: ImageSource) -> bool:
    """Whether a stored record is a complete result of the same source (by its hashes)."""
    if record.row.status != "ok" or record.scene is None:
        return False
    stored = as_json(record.scene)
    if any(stored.get(key) != value for key, value in as_json(source).items()):
        return False
    return has_its_results(record, run)


def _check_predictions(image: TrackImage, answer: Message, rules: AnswerRules) -> Predictions:
    if answer.predictions is None:
        raise AnswerInvalidError(
            "the baseline returned no predictions",
            found="an answer without them",
            expected='"predictions", a list',
        )
    protocol = detection_protocol(rules.task)
    assert rules.vocabulary is not None
    assert image.size_wh is not None
    return check_results(
        [as_predictions(answer.predictions, prediction_type(protocol))],
        status_by_image={image.id: "ok"},
        sizes_wh={image.id: image.size_wh},
        vocabulary=rules.vocabulary,
        protocol=protocol,
        order="given",
        check_boxes=check_box_values,
    )
