"""Logits and boxes to COCO results, as the original's evaluation makes them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from torch import Tensor

TOP = 300


def coco_results(
    logits: Tensor,
    boxes: Tensor,
    *,
    image_id: int,
    size_wh: tuple[int, int],
    category_ids: Collection[int],
) -> tuple[list[dict[str, Any]], int]:
    """The 300 best of all (query, class) pairs, and how many of them no category stands for.

    logits: (Q, 91), boxes: (Q, 4) cx, cy, w, h as fractions of the photo; size_wh in pixels.
    A class index is a COCO id. Indices that are no id (0, 12, 26, ...) take their places among
    the 300, as in the original, whose evaluator then never looks at them; here they are left out
    of the results and counted. No suppression; boxes are not clipped to the photo.
    """
    scores, places = logits.sigmoid().flatten().topk(min(TOP, logits.numel()))
    queries, classes = places // logits.shape[1], places % logits.shape[1]
    centre, half = boxes[queries, :2], 0.5 * boxes[queries, 2:]
    scale = boxes.new_tensor(size_wh)
    low, high = (centre - half) * scale, (centre + half) * scale
    rows = zip(classes.tolist(), scores.tolist(), low.tolist(), (high - low).tolist(), strict=True)
    results = [
        {"image_id": image_id, "category_id": category, "bbox": [*corner, *wh], "score": score}
        for category, score, corner, wh in rows
        if category in category_ids
    ]
    return results, len(scores) - len(results)
