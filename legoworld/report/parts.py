"""Predictions that are parts of one truth: a spoon's bowl and its handle, each labelled spoon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from legoworld.evaluation.detection.problem import Floats
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.report.detection_images import DetectionImage, SideImage, shapes
from legoworld.report.error_kinds import FOREGROUND_IOU

#: How much of a part lies in its truth. Below, it is a thing in the wrong place.
_INSIDE: Final = 0.8
#: How much better than the best of them parts are together. Below, they are copies of the whole.
_GAIN: Final = 0.05


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Predictions of one category that together cover a truth of it better than any of them.

    truth, predictions: positions in the image; best_iou, together_iou: of the best part and of all.
    """

    truth: int
    predictions: tuple[int, ...]
    best_iou: float
    together_iou: float


def shared_truth_parts(task: str, image: DetectionImage, side: SideImage) -> list[Parts]:
    """The truths of an image that several predictions of their category share; at most one each."""
    if not image.truths or len(side.entries) < 2:
        return []
    predicted = shapes(task, image.image, side.entries)
    truths = shapes(task, image.image, image.truths)
    payload = detection_protocol(task).payload
    compared, union = payload.compare_shapes, payload.enclose_shapes
    inside, parts = compared(predicted, truths, [1] * len(truths)), []
    for g, state in enumerate(side.errors.truth):
        members = _members(image, side, g, inside[:, g])
        if state == "ignored" or len(members) < 2:
            continue
        shared = [predicted[d] for d in members]
        best = float(compared(shared, [truths[g]], [0]).max())
        together = float(compared([union(shared)], [truths[g]], [0])[0, 0])
        if together >= max(FOREGROUND_IOU, best + _GAIN):
            parts.append(Parts(truth=g, predictions=members, best_iou=best, together_iou=together))
    return parts


def lone_part(task: str, image: DetectionImage, entry: int, side: SideImage) -> int | None:
    """The truth of its category that a prediction lies in; None where it lies in none."""
    category = side.entries[entry].category_id
    same = [g for g, t in enumerate(image.truths) if t.category_id == category]
    same = [g for g in same if side.errors.truth[g] != "ignored"]
    if not same:
        return None
    predicted = shapes(task, image.image, [side.entries[entry]])
    truths = shapes(task, image.image, [image.truths[g] for g in same])
    inside = detection_protocol(task).payload.compare_shapes(predicted, truths, [1] * len(same))[0]
    return same[int(inside.argmax())] if inside.max() >= _INSIDE else None


def _members(image: DetectionImage, side: SideImage, truth: int, inside: Floats) -> tuple[int, ...]:
    """The predictions of a truth's category that lie in it, its finder among them."""
    category = image.truths[truth].category_id
    finders = {d: g for g, d in enumerate(side.errors.finder) if d is not None}
    members = [
        d
        for d, entry in enumerate(side.entries)
        if entry.category_id == category
        and (finders.get(d) == truth or (side.errors.kind[d] and inside[d] >= _INSIDE))
    ]
    return tuple(members) if any(side.errors.kind[d] for d in members) else ()
