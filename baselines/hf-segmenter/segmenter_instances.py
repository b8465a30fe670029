"""From queries to detections: the cut, the masks at the photo's size, the entries."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from pycocotools import mask as coco_mask
from segmenter_network import Queries
from torch.nn import functional

#: Masks made at photo size together; bounds memory, changes nothing.
_MASKS_AT_ONCE = 16


@dataclass(frozen=True, kw_only=True)
class Rules:
    """categories: class of the network to category id, the others are left out.

    per_image: how many pairs of query and class are kept: highest share first, then the lower
    category id, then the lower query. min_score: detections below it are left out.
    """

    categories: Mapping[int, int]
    per_image: int
    min_score: float
    boxes: bool


def detections(
    said: Queries, rules: Rules, image_id: int, size_wh: tuple[int, int]
) -> tuple[list[dict[str, Any]], dict[str, int]]:
    """COCO or LVIS results of one photo, and what became of the candidates.

    As the authors do: one query may be kept with several classes; score = the class's share times
    the mean probability inside the mask.
    """
    kept = kept_pairs(said.class_shares, rules)
    masks = masks_at(said, [query for query, _ in kept], size_wh)
    counts = {"candidates": said.class_shares.shape[0] * len(rules.categories)}
    counts |= {"cut_image": counts["candidates"] - len(kept), "empty": 0, "below_score": 0}
    entries = []
    for (query, number), (mask, inside) in zip(kept, masks, strict=True):
        score = float(said.class_shares[query, number]) * inside
        if not mask.any():
            counts["empty"] += 1
        elif score < rules.min_score:
            counts["below_score"] += 1
        else:
            payload = {"bbox": box_xywh_px(mask)} if rules.boxes else {"segmentation": rle(mask)}
            entry = {"image_id": image_id, "category_id": rules.categories[number]}
            entries.append({**entry, **payload, "score": score})
    return entries, counts


def kept_pairs(class_shares: torch.Tensor, rules: Rules) -> list[tuple[int, int]]:
    """(query, class) pairs in the order of the cut."""
    numbers = sorted(rules.categories)
    shares = class_shares[:, numbers].cpu().numpy()
    query, column = (part.ravel() for part in np.indices(shares.shape))
    ids = np.array([rules.categories[number] for number in numbers])[column]
    order = np.lexsort((query, ids, -shares.ravel()))[: rules.per_image]
    return [(int(query[i]), numbers[column[i]]) for i in order]


def masks_at(
    said: Queries, asked: list[int], size_wh: tuple[int, int]
) -> Iterator[tuple[NDArray[np.bool_], float]]:
    """Of each query: its mask (height, width), and the mean probability inside it.

    Logits are resized to the network's input, its padding is cut off, the rest is resized to the
    photo (bilinear, pixel centres at .5), then > 0. transformers' own post-processing resizes
    finished masks of 384 x 384 by the nearest neighbour, padding included.
    """
    width, height = size_wh
    for start in range(0, len(asked), _MASKS_AT_ONCE):
        logits = said.mask_logits[asked[start : start + _MASKS_AT_ONCE]][None]
        whole = functional.interpolate(
            logits, size=said.input_hw, mode="bilinear", align_corners=False
        )
        photo = functional.interpolate(
            whole[..., : said.valid_hw[0], : said.valid_hw[1]],
            size=(height, width),
            mode="bilinear",
            align_corners=False,
        )[0]
        for one in photo:
            mask = one > 0
            inside = float(one[mask].sigmoid().mean()) if mask.any() else 0.0
            yield mask.cpu().numpy(), inside


def rle(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Compressed run lengths with text counts of a mask (H, W)."""
    encoded: Any = coco_mask.encode(np.asfortranarray(mask, np.uint8))
    return {
        "size": [int(side) for side in encoded["size"]],
        "counts": encoded["counts"].decode("ascii"),
    }


def box_xywh_px(mask: NDArray[np.bool_]) -> list[float]:
    """The extent of a mask (H, W) with at least one pixel: x, y, w, h at pixel edges."""
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    x, y = int(cols[0]), int(rows[0])
    return [float(v) for v in (x, y, int(cols[-1]) + 1 - x, int(rows[-1]) + 1 - y)]
