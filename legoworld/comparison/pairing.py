"""Which images are paired: scored on both sides, with truth to be right or wrong about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.depth.rows import SCORED
from legoworld.evaluation.folder import Row
from legoworld.evaluation.stored import Evaluated


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """kept: (images,) bool, images in ascending id; dropped: the others, with every reason."""

    kept: NDArray[np.bool_]
    dropped: tuple[Row, ...]


def pair_images(scene: Evaluated, baseline: Evaluated) -> Pairing:
    """Images that both sides scored and that have something to be right or wrong about.

    That is at least one truth instance that is neither crowd nor ignored; for depth, enough valid
    truth pixels.
    """
    dropped: list[Row] = []
    kept = np.ones(len(scene.rows), bool)
    for k, rows in enumerate(zip(scene.rows, baseline.rows, strict=True)):
        reasons = _without_truth(rows[0])
        for side, row in zip((scene, baseline), rows, strict=True):
            reasons += _without_score(side.name, row)
        if reasons:
            kept[k] = False
            row = rows[0]
            dropped.append(
                {"image_id": row["image_id"], "file_name": row["file_name"], "reasons": reasons}
            )
    return Pairing(kept=kept, dropped=tuple(dropped))


def is_scored(row: dict[str, Any]) -> bool:
    """Whether an evaluation's row of an image counts as scored."""
    return bool(row["scored"]) if "scored" in row else row["status"] in SCORED


def has_truth(row: dict[str, Any]) -> bool:
    """Whether an image has truth that a prediction can be right or wrong about."""
    return bool(row["n_truth"] > 0) if "n_truth" in row else row["status"] != "no_gt"


def _without_score(name: str, row: dict[str, Any]) -> list[str]:
    """Why a side has no score, beyond having no truth: what became of its own output."""
    status = row["run_status"] if row["status"] == "no_gt" else row["status"]
    return [] if is_scored(row) or status == "ok" else [f"{name}: {status}"]


def _without_truth(row: dict[str, Any]) -> list[str]:
    if has_truth(row):
        return []
    if "n_valid" in row:
        return [f"no truth: {row['n_valid']} valid pixels"]
    ignored = row["n_ignored_truth"]
    return [f"no truth: {ignored} crowd or ignored instances" if ignored else "no truth"]
