"""The images of a detection section: what each side found, missed and invented in every photo."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import plural
from legoworld.records.coco_file import ShownPrediction, TrueAnnotation, TrueImage
from legoworld.records.detection import DetectionRow
from legoworld.records.run_file import ImageSource
from legoworld.records.run_rows import RunRow
from legoworld.report.error_kinds import ImageErrors, image_errors
from legoworld.report.sources import ReportInputError

R = TypeVar("R", TrueAnnotation, ShownPrediction)


@dataclass(frozen=True, kw_only=True)
class SideImage:
    """One side's answer to one photo.

    entries: its predictions in canonical order, as view/predictions.json has them; places: where
    they stand there; iou: (D, G) their overlaps as the evaluator measures them; quality: the
    photo's own panoptic quality, None where there is neither truth nor a false positive.
    """

    row: DetectionRow
    run_row: RunRow
    scene: ImageSource | None
    entries: tuple[ShownPrediction, ...]
    places: tuple[int, ...]
    iou: NDArray[np.float64]
    errors: ImageErrors

    @property
    def quality(self) -> float | None:
        """Sum of IoU over pairs at 0.5 over (TP + FP/2 + FN/2) (Kirillov et al., CVPR 2019)."""
        measures = self.row.class_aware
        total = measures.n_gt + measures.n_dt
        return 2 * measures.quality_sum / total if total else None

    @property
    def n_missed(self) -> int:
        """False negatives at IoU 0.5: scored truths without a true positive."""
        return sum(state in ("missed", "reached") for state in self.errors.truth)


@dataclass(frozen=True, kw_only=True)
class DetectionImage:
    """One photo: its truths in file order, and every side's answer in the section's order."""

    image: TrueImage
    truths: tuple[TrueAnnotation, ...]
    sides: tuple[SideImage, ...]


def detection_images(sides: Sequence[StoredEvaluation]) -> Iterator[DetectionImage]:
    """The photos of a section's track, ascending id, one at a time."""
    truth = sides[0].truth_view()
    truths = _by_image(truth.annotations)
    shown = [side.prediction_views() for side in sides]
    entries = [_by_image(of_side) for of_side in shown]
    places = [_places(of_side) for of_side in shown]
    rows = [{row.image_id: row for row in side.detection_rows} for side in sides]
    for image in sorted(truth.images, key=lambda i: i.id):
        annotated = tuple(truths.get(image.id, ()))
        answers = []
        for side, mine, at, row in zip(sides, entries, places, rows, strict=True):
            predictions = tuple(mine.get(image.id, ()))
            iou = _overlaps(side.task, image, annotated, predictions)
            answers.append(
                SideImage(
                    row=row[image.id],
                    run_row=side.run_rows[image.id],
                    scene=side.source(image.id),
                    entries=predictions,
                    places=tuple(at.get(image.id, ())),
                    iou=iou,
                    errors=_errors(side.task, image, annotated, predictions, iou),
                )
            )
        yield DetectionImage(image=image, truths=annotated, sides=tuple(answers))


def _errors(
    task: str,
    image: TrueImage,
    truths: Sequence[TrueAnnotation],
    predictions: Sequence[ShownPrediction],
    iou: NDArray[np.float64],
) -> ImageErrors:
    outcome = [p.outcome_50 for p in predictions]
    errors = image_errors(
        outcome=outcome,
        category=np.array([p.category_id for p in predictions], np.int64),
        score=np.array([p.score for p in predictions], np.float64),
        truth_category=np.array([t.category_id for t in truths], np.int64),
        ignored=np.array([_is_ignored(task, t) for t in truths], bool),
        iou=iou,
    )
    if outcome.count("tp") != sum(f is not None for f in errors.finder):
        raise ReportInputError(
            f"view/ does not repeat the matches of image {image.id}",
            found=f"{plural(sum(f is not None for f in errors.finder), 'truth', 'truths')} found",
            expected=f"{outcome.count('tp')} true positives",
            next_step="evaluate again",
        )
    return errors


def _is_ignored(task: str, truth: TrueAnnotation) -> bool:
    """What neither scores nor is missed: COCO's crowds; LVIS's ignored and empty truths."""
    protocol = detection_protocol(task)
    if protocol.federated:
        return bool(truth.ignore) or (truth.area or 0) <= 0
    return bool(truth.ignore if protocol.payload.own_ignore else truth.iscrowd)


def _overlaps(
    task: str,
    image: TrueImage,
    truths: Sequence[TrueAnnotation],
    predictions: Sequence[ShownPrediction],
) -> NDArray[np.float64]:
    """(D, G) IoU as the evaluator measures it: of boxes, or of masks; COCO's own for its crowds."""
    if not truths or not predictions:
        return np.zeros((len(predictions), len(truths)))
    shapes_of_both = shapes(task, image, predictions), shapes(task, image, truths)
    protocol = detection_protocol(task)
    crowd = [0 if protocol.federated else int(bool(t.iscrowd)) for t in truths]
    return protocol.payload.compare_shapes(*shapes_of_both, crowd)


def shapes(
    task: str, image: TrueImage, rows: Sequence[TrueAnnotation] | Sequence[ShownPrediction]
) -> list[Any]:
    """Geometry of predictions or truths that IoU compares: boxes, or RLE masks."""
    shape, size_hw = detection_protocol(task).payload.shape, (image.height, image.width)
    return [shape(row, size_hw) for row in rows]


def _places(rows: Sequence[ShownPrediction]) -> dict[int, list[int]]:
    places: dict[int, list[int]] = {}
    for place, row in enumerate(rows):
        places.setdefault(row.image_id, []).append(place)
    return places


def _by_image(rows: Sequence[R]) -> dict[int, list[R]]:
    by_image: dict[int, list[R]] = {}
    for row in rows:
        by_image.setdefault(row.image_id, []).append(row)
    return by_image
