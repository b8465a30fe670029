"""Which pairs of box and prompt of a photo become predictions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from zero_shot_networks import Pass


def results(
    passes: Iterable[Pass],
    category_ids: Sequence[int],
    image_id: int,
    *,
    per_image: int,
    min_score: float,
) -> tuple[list[dict[str, Any]], dict[str, int]]:
    """COCO results of one photo, and what became of the candidates.

    A box may be kept with several prompts. Order of the cut: score, highest first; then the lower
    category id; then the network's earlier box. category_ids: of each prompt.
    """
    scores, ids, boxes = [], [], []
    for one in passes:
        own = np.asarray([category_ids[column] for column in one.columns])
        scores.append(one.scores.ravel())
        ids.append(np.tile(own, len(one.scores)))
        boxes.append(np.repeat(one.boxes_xyxy_px.astype(np.float64), len(own), axis=0))
    score, category, box = (np.concatenate(part) for part in (scores, ids, boxes))
    above = np.flatnonzero(score >= min_score)
    order = above[np.lexsort((above, category[above], -score[above]))][:per_image]
    entries = []
    for i in order:
        x0, y0, x1, y1 = box[i].tolist()
        entries.append(
            {
                "image_id": image_id,
                "category_id": int(category[i]),
                "bbox": [x0, y0, x1 - x0, y1 - y0],
                "score": float(score[i]),
            }
        )
    counts = {"candidates": len(score), "below_score": len(score) - len(above)}
    return entries, {**counts, "cut_image": len(above) - len(order)}
