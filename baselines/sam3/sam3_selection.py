"""Which candidates of an image become predictions, and their masks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from pycocotools import mask as coco_mask
from sam3_network import Answers
from sam3_options import Limits
from torch.nn import functional

#: Masks made at photo size together; bounds memory, changes nothing.
_MASKS_AT_ONCE = 16


@dataclass(frozen=True, kw_only=True)
class Candidates:
    """k candidates in the order of the cut. mask_logits: of each, (h, w); the rest (k,)."""

    scores: NDArray[np.float32]
    category_ids: NDArray[np.int64]
    queries: NDArray[np.int64]
    mask_logits: tuple[torch.Tensor, ...]

    def __len__(self) -> int:
        return len(self.scores)


_NOTHING = Candidates(
    scores=np.empty(0, np.float32),
    category_ids=np.empty(0, np.int64),
    queries=np.empty(0, np.int64),
    mask_logits=(),
)


class Selection:
    """The best candidates of an image so far, phrase after phrase, within its limits.

    Keeping the best of what came so far gives what a cut over everything at once would give: the
    order is total. counts: what happened to the candidates.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.kept: Candidates | None = None
        self.counts = {"candidates": 0, "below_score": 0, "cut_category": 0, "cut_image": 0}

    def add(self, category_ids: list[int], answers: Answers) -> None:
        """Take the answers to n phrases, one category each; a category comes once an image.

        ValueError when a score is not a number.
        """
        scores = answers.scores.cpu().numpy()
        if not np.isfinite(scores).all():
            raise ValueError("the network's scores are not finite (with float16, try float32)")
        rows, queries = _best_of_each(scores, self.limits)
        above = int((scores >= self.limits.min_score).sum())
        self.counts["candidates"] += scores.size
        self.counts["below_score"] += scores.size - above
        self.counts["cut_category"] += above - len(rows)
        ids = np.asarray(category_ids, np.int64)[rows]
        self._merge(scores[rows, queries], ids, rows, queries, answers.mask_logits)

    def _merge(
        self,
        scores: NDArray[np.float32],
        category_ids: NDArray[np.int64],
        rows: NDArray[np.int64],
        queries: NDArray[np.int64],
        mask_logits: torch.Tensor,
    ) -> None:
        """Cut by score first; of the new masks, only those that stay are copied."""
        old = self.kept or _NOTHING
        scores = np.concatenate([old.scores, scores])
        category_ids = np.concatenate([old.category_ids, category_ids])
        queries = np.concatenate([old.queries, queries])
        order = np.lexsort((queries, category_ids, -scores))[: self.limits.per_image]
        self.counts["cut_image"] += len(scores) - len(order)
        self.kept = Candidates(
            scores=scores[order],
            category_ids=category_ids[order],
            queries=queries[order],
            mask_logits=tuple(
                old.mask_logits[i]
                if i < len(old)
                else mask_logits[int(rows[i - len(old)]), int(queries[i])].clone()
                for i in map(int, order)
            ),
        )

    def predictions(self, image_id: int, size_wh: tuple[int, int]) -> list[dict[str, Any]]:
        """Entries of LVIS results in the order of the cut; masks without a pixel are dropped."""
        if self.kept is None:
            return []
        masks = masks_at(self.kept.mask_logits, size_wh)
        rles = [rle for chunk in masks for rle in _encoded(chunk)]
        entries = [
            {
                "image_id": image_id,
                "category_id": int(category_id),
                "segmentation": rle,
                "score": float(score),
            }
            for category_id, score, rle in zip(
                self.kept.category_ids, self.kept.scores, rles, strict=True
            )
            if rle is not None
        ]
        self.counts["empty"] = len(rles) - len(entries)
        return entries


def masks_at(
    mask_logits: Sequence[torch.Tensor], size_wh: tuple[int, int]
) -> Iterator[NDArray[np.bool_]]:
    """Masks (n, height, width) of k logits (h, w), some at a time: logits resized, then > 0.

    Bilinear with pixel centres at .5 (align_corners=False), in float32: the official code's
    order. Resizing probabilities instead and cutting at one half moves edges.
    """
    width, height = size_wh
    for start in range(0, len(mask_logits), _MASKS_AT_ONCE):
        chunk = torch.stack(list(mask_logits[start : start + _MASKS_AT_ONCE]))[:, None].float()
        resized = functional.interpolate(
            chunk, size=(height, width), mode="bilinear", align_corners=False
        )
        yield (resized[:, 0] > 0).cpu().numpy()


def _encoded(masks: NDArray[np.bool_]) -> list[dict[str, Any] | None]:
    """Compressed run lengths with text counts of masks (n, H, W); None for one without a pixel."""
    found: list[dict[str, Any] | None] = []
    for mask in masks:
        if not mask.any():
            found.append(None)
            continue
        rle: Any = coco_mask.encode(np.asfortranarray(mask, np.uint8))
        size = [int(side) for side in rle["size"]]
        found.append({"size": size, "counts": rle["counts"].decode("ascii")})
    return found


def _best_of_each(
    scores: NDArray[np.float32], limits: Limits
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and query of the candidates (n, q) that pass the score and the cut per category."""
    order = np.argsort(-scores, axis=1, kind="stable")[:, : limits.per_category]
    rows = np.repeat(np.arange(len(scores)), order.shape[1])
    queries = order.ravel()
    passed = scores[rows, queries] >= limits.min_score
    return rows[passed], queries[passed]
