"""Greedy matching and score-free pairing an image at a time: what compiled loops are held to.

Written from cocoeval.py, lvis/eval.py and docs/protocols; overlaps by pycocotools' own functions,
pairs by scipy's.
"""

from __future__ import annotations

import numpy as np
from pycocotools import mask as coco_mask
from scipy.optimize import linear_sum_assignment

from legoworld.evaluation.detection.grid import PICTURE
from legoworld.evaluation.detection.inputs.masks import areas_px, compress_mask
from legoworld.evaluation.detection.matching.matched_metrics import HIT
from legoworld.evaluation.detection.matching.outcomes import (
    FALSE_POSITIVE,
    IGNORED,
    TRUE_POSITIVE,
)

PREFER_HIT, PREFER_LABEL = 1e-9, 1e-11
THRESHOLDS = np.minimum(PICTURE.iou, 1 - 1e-10)
LOW, HIGH = np.array(PICTURE.ranges).T


def overlaps(chunk):
    """As the payload's overlaps: (iou, area)."""
    found = [np.empty(0)]
    for size_hw, mine, true in places(chunk):
        if chunk.payload.iou_type == "bbox":
            shapes, wanted = chunk.shapes[mine], chunk.true_shapes[true]
        else:
            shapes = [mask(counts, size_hw) for counts in chunk.shapes[mine]]
            wanted = [compress_mask(m, size_hw) for m in chunk.true_shapes[true]]
        found.append(coco_mask.iou(shapes, wanted, chunk.truths.crowd[true].astype(int).tolist()))
    return np.concatenate([iou.ravel() for iou in found]), areas(chunk)


def places(chunk):
    """(size, slice of its detections, slice of its truths) of each image that has both."""
    for i, size_hw in enumerate(chunk.sizes_hw):
        mine = slice(*np.searchsorted(chunk.detections.image, [i, i + 1]))
        true = slice(*np.searchsorted(chunk.truths.image, [i, i + 1]))
        if mine.start < mine.stop and true.start < true.stop:
            yield size_hw, mine, true


def images(chunk, iou):
    """(slice of its detections, slice of its truths, overlaps) of each image that has both."""
    for _, mine, true in places(chunk):
        shape = mine.stop - mine.start, true.stop - true.start
        yield mine, true, iou[: shape[0] * shape[1]].reshape(shape)
        iou = iou[shape[0] * shape[1] :]


def areas(chunk):
    """(D,) what the evaluators take for a detection's area."""
    if chunk.payload.iou_type == "bbox":
        return chunk.shapes[:, 2] * chunk.shapes[:, 3]
    sizes = [chunk.sizes_hw[i] for i in chunk.detections.image]
    return areas_px([mask(*one) for one in zip(chunk.shapes, sizes, strict=True)])


def mask(counts, size_hw):
    return {"size": list(size_hw), "counts": counts.encode("ascii")}


def states(chunk, iou, area):
    """(A, T, D), as compiled_matching.match_chunk_states."""
    detections, truths = chunk.detections, chunk.truths
    state = np.full((len(LOW), len(THRESHOLDS), len(detections.image)), FALSE_POSITIVE, np.uint8)
    for mine, true, found in images(chunk, iou):
        categories, true_categories = detections.category[mine], truths.category[true]
        true_area = truths.area[true]
        outside = (true_area < LOW[:, None]) | (true_area > HIGH[:, None])
        ignored = truths.ignored[true] | outside
        for category in np.intersect1d(categories, true_categories):
            rows = np.flatnonzero(categories == category)
            columns = np.flatnonzero(true_categories == category)
            matched, to_ignored = greedy(
                found[np.ix_(rows, columns)], ignored[:, columns], truths.crowd[true][columns]
            )
            kinds = np.where(matched, TRUE_POSITIVE, FALSE_POSITIVE)
            state[:, :, mine.start + rows] = np.where(to_ignored, IGNORED, kinds)
    for lane, low, high in zip(state, LOW, HIGH, strict=True):
        forgiven = (area < low) | (area > high) | ~detections.exhaustive
        lane[(lane == FALSE_POSITIVE) & forgiven] = IGNORED
    return state


def greedy(iou, ignored, crowd):
    """(matched, matched to an ignored truth), each (A, T, D).

    iou: (D, G), detections by falling score, truths in file order; ignored: (A, G);
    crowd: (G,), truths that any number of detections may match.
    """
    lanes = (len(ignored), len(THRESHOLDS))
    matched, to_ignored = np.zeros((2, *lanes, len(iou)), bool)
    free = np.ones((*lanes, iou.shape[1]), bool)
    regular = ~ignored[:, None, :]
    for d in np.flatnonzero((iou >= THRESHOLDS[0]).any(axis=1)):
        reached = free & (iou[d] >= THRESHOLDS[:, None])
        # A regular truth is always preferred; of equal overlaps the later truth wins.
        preferred = reached & regular
        use = np.where(preferred.any(axis=2)[..., None], preferred, reached)
        best = iou.shape[1] - 1 - np.argmax(np.where(use, iou[d], -1.0)[..., ::-1], axis=2)
        hit = use.any(axis=2)
        matched[..., d] = hit
        to_ignored[..., d] = hit & np.take_along_axis(ignored, best, axis=1)
        a, t = np.nonzero(hit & ~crowd[best])
        free[a, t, best[a, t]] = False
    return matched, to_ignored


def pairs(chunk, overlap, *, class_aware):
    """([(detection, truth, iou)], counted), as of compiled_matching.pair_chunk."""
    detections, truths = chunk.detections, chunk.truths
    forgiven = ~detections.exhaustive | ~detections.verified
    found = []
    for mine, true, whole in images(chunk, overlap):
        categories, true_categories = detections.category[mine], truths.category[true]
        if not class_aware:
            groups = [(np.arange(len(categories)), np.arange(len(true_categories)))]
        else:
            both = np.intersect1d(categories[detections.verified[mine]], true_categories)
            groups = [
                (np.flatnonzero(categories == c), np.flatnonzero(true_categories == c))
                for c in both
            ]
        for rows, columns in groups:
            ignored = truths.ignored[true][columns]
            part = whole[np.ix_(rows, columns)]
            same = categories[rows][:, None] == true_categories[columns][~ignored]
            chosen, partner = best_pairs(part[:, ~ignored], same)
            iou = part[:, ~ignored][chosen, partner]
            at = mine.start + rows
            found += zip(at[chosen], true.start + columns[~ignored][partner], iou, strict=True)
            free = ~forgiven[at]
            free[chosen[iou >= HIT]] = False
            crowd = truths.crowd[true][columns][ignored]
            forgiven[at[forgiven_by(part[:, ignored], crowd, free)]] = True
    counted = ~forgiven
    counted[[d for d, _, iou in found if iou >= HIT]] = True
    return found, counted


def forgiven_by(iou, crowd, free):
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


def best_pairs(iou, same_label):
    """Rows and columns of the one-to-one pairs of greatest total overlap, without zero pairs."""
    hit = iou >= HIT
    worth = iou + PREFER_HIT * hit + PREFER_LABEL * (hit & same_label)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    some = iou[rows, columns] > 0
    return rows[some], columns[some]
