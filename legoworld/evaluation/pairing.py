"""Matched IoU, free of scores: one-to-one pairs that maximise total overlap (Kuhn, Hungarian).

docs/protocols/coco.md and lvis.md define the numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from legoworld.evaluation.matching import ImageOverlaps
from legoworld.evaluation.problem import Bools, Detections, Floats, Ints, TrueInstances

#: A pair at least this good is a true positive of precision and recall.
HIT: Final = 0.5
_PREFER_HIT: Final = 1e-9
_PREFER_LABEL: Final = 1e-11


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Pairs of a run, or of some of its images, and what they are counted against.

    detection, truth: (P,) positions in its columns; iou: (P,), all above 0; counted: (D,)
    detections that are answered for: paired at HIT or better, or not forgiven by the official
    rules (in a crowd, on an ignored instance, category unverified or not exhaustively annotated).
    """

    detection: Ints
    truth: Ints
    iou: Floats
    counted: Bools


class Pairer:
    """Collects the pairs of images; within categories, or across them."""

    def __init__(self, detections: Detections, truths: TrueInstances, *, class_aware: bool) -> None:
        self._detections = detections
        self._truths = truths
        self._class_aware = class_aware
        self._pairs: list[tuple[Ints, Ints, Floats]] = []
        self._forgiven = ~detections.exhaustive | ~detections.verified

    def add(self, found: ImageOverlaps) -> None:
        """Pair one image's detections and truths."""
        categories = self._detections.category[found.detections]
        true_categories = self._truths.category[found.truths]
        if not self._class_aware:
            self._pair(found, np.arange(len(categories)), np.arange(len(true_categories)))
            return
        verified = self._detections.verified[found.detections]
        for category in np.intersect1d(categories[verified], true_categories):
            rows = np.flatnonzero(categories == category)
            self._pair(found, rows, np.flatnonzero(true_categories == category))

    def result(self) -> Pairs:
        """Everything added so far."""
        nothing = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
        columns = zip(*self._pairs, nothing, strict=True)
        detection, truth, iou = (np.concatenate(column) for column in columns)
        counted = ~self._forgiven
        counted[detection[iou >= HIT]] = True
        return Pairs(detection=detection, truth=truth, iou=iou, counted=counted)

    def _pair(self, found: ImageOverlaps, rows: Ints, columns: Ints) -> None:
        ignored = self._truths.ignored[found.truths][columns]
        iou = found.iou[np.ix_(rows, columns)]
        same_label = (
            self._detections.category[found.detections][rows][:, None]
            == self._truths.category[found.truths][columns][~ignored]
        )
        chosen, true = best_pairs(iou[:, ~ignored], same_label)
        self._pairs.append(
            (
                found.detections.start + rows[chosen],
                found.truths.start + columns[~ignored][true],
                iou[:, ~ignored][chosen, true],
            )
        )
        free = ~self._forgiven[found.detections.start + rows]
        free[chosen[iou[:, ~ignored][chosen, true] >= HIT]] = False
        crowd = self._truths.crowd[found.truths][columns]
        forgiven = forgiven_by(iou[:, ignored], crowd[ignored], free)
        self._forgiven[found.detections.start + rows[forgiven]] = True


def forgiven_by(iou: Floats, crowd: Bools, free: Bools) -> Ints:
    """Rows of detections that ignored truths forgive, of those that are free.

    iou: (D, G) with the ignored truths; crowd: (G,). A crowd forgives any number of detections, an
    ignored instance of LVIS one, as lvis matches them: of all ways to share these out, one that
    forgives most.
    """
    hit = (iou >= HIT) & free[:, None]
    in_crowd = hit[:, crowd].any(axis=1)
    rows = np.flatnonzero(hit[:, ~crowd].any(axis=1) & ~in_crowd)
    claims = hit[np.ix_(rows, np.flatnonzero(~crowd))]
    chosen, truth = linear_sum_assignment(claims.astype(np.float64), maximize=True)
    return np.concatenate([np.flatnonzero(in_crowd), rows[chosen[claims[chosen, truth]]]])


def best_pairs(iou: Floats, same_label: Bools) -> tuple[Ints, Ints]:
    """Rows and columns of the one-to-one pairs of greatest total overlap, without zero pairs.

    Where totals are equal (to about nine decimals): more pairs that are hits, then more hits of
    the right label. Without that rule the numbers would depend on the order of the ids.
    """
    hit = iou >= HIT
    worth = iou + _PREFER_HIT * hit + _PREFER_LABEL * (hit & same_label)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    some = iou[rows, columns] > 0
    return rows[some], columns[some]
