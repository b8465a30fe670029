"""Why a detection is false and a truth missed: the error kinds of TIDE.

Bolya, Foley, Hays and Hoffman, "TIDE: A General Toolbox for Identifying Object Detection Errors",
ECCV 2020, with its thresholds 0.5 (foreground) and 0.1 (background), and in the order its published
program asks. Only errors are explained here: what is a true or a false positive, or ignored, is
the evaluator's own answer at IoU 0.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

FOREGROUND_IOU: Final = 0.5
BACKGROUND_IOU: Final = 0.1

Kind = Literal["classification", "localisation", "both", "duplicate", "background"]
TruthState = Literal["found", "reached", "missed", "ignored"]
#: In the order they are shown; "missed" counts truths, the others predictions.
KINDS: Final[tuple[str, ...]] = (
    "classification",
    "localisation",
    "both",
    "duplicate",
    "background",
    "missed",
)


@dataclass(frozen=True, kw_only=True)
class ImageErrors:
    """One image's predictions and truths, explained.

    kind: of each prediction, None where it is no false positive; about: the truth it took or fails
    on, None where there is none; iou: its IoU with that truth; truth: each truth's state, "reached"
    when a classification or localisation error would find it; finder: the prediction that found it;
    cover: of each missed truth the prediction that is not counted and overlaps it most, where that
    is enough to find it, and cover_iou: by how much.
    """

    kind: tuple[Kind | None, ...]
    about: tuple[int | None, ...]
    iou: tuple[float | None, ...]
    truth: tuple[TruthState, ...]
    finder: tuple[int | None, ...]
    cover: tuple[int | None, ...]
    cover_iou: tuple[float | None, ...]

    def counts(self) -> dict[str, int]:
        """How many of each of KINDS."""
        by_kind: dict[str, int] = {kind: sum(k == kind for k in self.kind) for kind in KINDS[:-1]}
        return {**by_kind, "missed": self.truth.count("missed")}


def image_errors(
    *,
    outcome: Sequence[str],
    category: NDArray[np.int64],
    score: NDArray[np.float64],
    truth_category: NDArray[np.int64],
    ignored: NDArray[np.bool_],
    iou: NDArray[np.float64],
) -> ImageErrors:
    """Explain one image.

    outcome: of D predictions at IoU 0.5 ("tp", "fp", ...) in the evaluator's order of equal scores;
    category, score: (D,); truth_category, ignored: (G,); iou: (D, G), only read for truths that
    are not ignored.
    """
    counted = iou * ~ignored
    same = category[:, None] == truth_category
    finder = _finders(outcome, score, np.where(same, counted, 0.0))
    used = np.array([f is not None for f in finder], bool)
    took = {d: g for g, d in enumerate(finder) if d is not None}
    kinds: list[Kind | None] = [None] * len(outcome)
    about: list[int | None] = [took.get(d) for d in range(len(outcome))]
    reached = np.zeros(len(truth_category), bool)
    false = [d for d, name in enumerate(outcome) if name == "fp"]
    for d, told in zip(false, _kinds(counted[false], same[false], used), strict=True):
        kinds[d], about[d] = told
        if kinds[d] in ("classification", "localisation"):
            reached[about[d]] = True
    states: list[TruthState] = [
        "ignored" if i else "found" if u else "reached" if r else "missed"
        for i, u, r in zip(ignored, used, reached, strict=True)
    ]
    uncounted = np.array([name not in ("tp", "fp") for name in outcome], bool)
    cover = [_cover(iou[:, g], uncounted) if s == "missed" else None for g, s in enumerate(states)]
    overlap = [None if g is None else float(iou[d, g]) for d, g in enumerate(about)]
    return ImageErrors(
        kind=tuple(kinds),
        about=tuple(about),
        iou=tuple(overlap),
        truth=tuple(states),
        finder=tuple(finder),
        cover=tuple(cover),
        cover_iou=tuple(None if d is None else float(iou[d, g]) for g, d in enumerate(cover)),
    )


def _cover(iou: NDArray[np.float64], uncounted: NDArray[np.bool_]) -> int | None:
    """The prediction that is not counted and would find a truth; iou: (D,) with it."""
    of_uncounted = np.where(uncounted, iou, 0.0)
    if not len(iou) or of_uncounted.max() < FOREGROUND_IOU:
        return None
    return int(of_uncounted.argmax())


def _finders(
    outcome: Sequence[str], score: NDArray[np.float64], same_iou: NDArray[np.float64]
) -> list[int | None]:
    """The true positive that took each truth, by the evaluators' greedy rule."""
    free = same_iou.copy()
    finder: list[int | None] = [None] * same_iou.shape[1]
    for d in np.argsort(-score, kind="stable").tolist():
        if outcome[d] != "tp" or not free.shape[1]:
            continue
        # Of equal overlaps the later truth wins, as in pycocotools.
        best = free.shape[1] - 1 - int(np.argmax(free[d, ::-1]))
        if free[d, best] >= FOREGROUND_IOU:
            finder[best] = d
            free[:, best] = 0.0
    return finder


def _kinds(
    iou: NDArray[np.float64], same: NDArray[np.bool_], used: NDArray[np.bool_]
) -> list[tuple[Kind, int | None]]:
    """The kind of each false positive and the truth it is about; iou, same: (D, G); used: (G,)."""
    if not iou.shape[1]:
        return [("background", None)] * len(iou)
    own, other = np.where(same, iou, 0.0), np.where(same, 0.0, iou)
    taken = np.where(used, own, 0.0)
    most, most_own = iou.max(axis=1), own.max(axis=1)
    # The first that holds, as TIDE asks.
    asked: list[tuple[Kind, NDArray[np.bool_], NDArray[np.float64]]] = [
        ("localisation", (most_own >= BACKGROUND_IOU) & (most_own <= FOREGROUND_IOU), own),
        ("classification", other.max(axis=1) >= FOREGROUND_IOU, other),
        ("duplicate", taken.max(axis=1) >= FOREGROUND_IOU, taken),
        ("background", most <= BACKGROUND_IOU, iou),
        ("both", np.ones(len(iou), bool), iou),
    ]
    first = np.argmax([holds for _, holds, _ in asked], axis=0)
    about = np.choose(first, [of.argmax(axis=1) for _, _, of in asked])
    names = [name for name, _, _ in asked]
    return [
        (names[k], None if names[k] == "background" else g)
        for k, g in zip(first.tolist(), about.tolist(), strict=True)
    ]
