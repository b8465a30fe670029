"""Pairing of images: scored on both sides and with ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.stored import Evaluated
from legoworld.records.comparison import Dropped
from legoworld.records.evaluation_kinds import TaskRow
from legoworld.records.evaluation_rows import DepthRow, DetectionRow, ScoredDepthRow
from legoworld.records.reconstruction_rows import ReconstructionRow

AnyRow = TaskRow


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """kept: (images,) bool, images in ascending id; dropped: the other images, with all reasons."""

    kept: NDArray[np.bool_]
    dropped: tuple[Dropped, ...]


def pair_images(scene: Evaluated, baseline: Evaluated) -> Pairing:
    """Images that both sides scored and that have usable ground truth.

    Usable is at least one annotation that is neither crowd nor ignored; for depth, enough valid
    truth pixels. A bench's case is scored where the submission is valid.
    """
    dropped: list[Dropped] = []
    kept = np.ones(len(scene.rows), bool)
    for k, rows in enumerate(zip(scene.rows, baseline.rows, strict=True)):
        reasons = _without_truth(rows[0])
        for side, row in zip((scene, baseline), rows, strict=True):
            reasons += _without_score(side.name, row)
        if reasons:
            kept[k] = False
            row = rows[0]
            dropped.append(
                Dropped(image_id=row.image_id, file_name=row.file_name, reasons=tuple(reasons))
            )
    return Pairing(kept=kept, dropped=tuple(dropped))


def is_scored(row: AnyRow) -> bool:
    """Whether an evaluation's row of an image counts as scored."""
    if isinstance(row, ReconstructionRow):
        return row.valid
    return row.scored if isinstance(row, DetectionRow) else isinstance(row, ScoredDepthRow)


def has_truth(row: AnyRow) -> bool:
    """Whether an image has usable ground truth."""
    if isinstance(row, ReconstructionRow):
        return True  # a case without an eligible object is refused when it is made
    return row.n_truth > 0 if isinstance(row, DetectionRow) else row.status != "no_gt"


def _without_score(name: str, row: AnyRow) -> list[str]:
    """Why a side has no score, apart from missing ground truth: the outcome of its own run."""
    status = row.status
    if isinstance(row, ReconstructionRow) and not row.valid:
        return [f"{name}: {'not valid' if status == 'ok' else status}"]
    if isinstance(row, DepthRow) and status == "no_gt":
        status = row.run_status
    return [] if is_scored(row) or status == "ok" else [f"{name}: {status}"]


def _without_truth(row: AnyRow) -> list[str]:
    if has_truth(row):
        return []
    if isinstance(row, DepthRow):
        return [f"no truth: {row.n_valid} valid pixels"]
    ignored = row.n_ignored_truth if isinstance(row, DetectionRow) else 0
    return [f"no truth: {ignored} crowd or ignored instances" if ignored else "no truth"]
