"""Pairing of images: scored on both sides and with ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.comparison import Dropped


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """kept: (images,) bool, images in ascending id; dropped: the other images, with all reasons."""

    kept: NDArray[np.bool_]
    dropped: tuple[Dropped, ...]


def pair_images(scene: StoredEvaluation, baseline: StoredEvaluation) -> Pairing:
    """Images that both sides scored and that have usable ground truth.

    Usable is at least one annotation that is neither crowd nor ignored; for depth, enough valid
    truth pixels. A bench's case is scored where the submission is valid.
    """
    dropped: list[Dropped] = []
    kept = np.ones(len(scene.rows), bool)
    for k, rows in enumerate(zip(scene.rows, baseline.rows, strict=True)):
        reasons = [rows[0].truth_gap]
        for side, row in zip((scene, baseline), rows, strict=True):
            reasons.append(row.score_gap and f"{side.name}: {row.score_gap}")
        reasons = [reason for reason in reasons if reason]
        if reasons:
            kept[k] = False
            row = rows[0]
            dropped.append(
                Dropped(image_id=row.image_id, file_name=row.file_name, reasons=tuple(reasons))
            )
    return Pairing(kept=kept, dropped=tuple(dropped))
