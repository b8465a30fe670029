"""Ground truth and predictions of a run as columns, in the official evaluators' order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from legoworld.evaluation.detection.inputs.prediction_columns import PredictionColumns
from legoworld.evaluation.detection.inputs.prediction_order import rank_in_group
from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.protocols import DetectionProtocol

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Detections:
    """Kept detections, ordered by image, category, falling score, place in the predictions.

    image, category: (D,) positions in Problem.image_ids and .category_ids; rank: (D,) place in
    its image and category, from 0; entry: (D,) position in the predictions; verified: the
    category is present in the image's truth or known to be absent (always so in COCO);
    exhaustive: all its instances are annotated there (always so in COCO).
    """

    image: Ints
    category: Ints
    score: Floats
    rank: Ints
    entry: Ints
    verified: Bools
    exhaustive: Bools


@dataclass(frozen=True, kw_only=True)
class TrueInstances:
    """Truth instances that take part, ordered by image; file order inside an image.

    ignored: the annotation's `ignore`, or COCO's crowd; crowd: COCO's iscrowd.
    """

    image: Ints
    category: Ints
    area: Floats
    ignored: Bools
    crowd: Bools
    annotation: Ints


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Everything matching needs, besides the overlaps.

    n_over_cap: predictions lost to the protocol's cap; n_unverified: predictions in categories
    not annotated in their image, which LVIS drops.
    """

    protocol: DetectionProtocol
    image_ids: Ints
    category_ids: Ints
    detections: Detections
    truths: TrueInstances
    n_over_cap: int
    n_unverified: int


def build_problem(truth: Truth, predictions: Predictions, protocol: DetectionProtocol) -> Problem:
    """Columns of checked truth and predictions, after the protocol's caps."""
    image_ids = np.array([i["id"] for i in truth.images], np.int64)
    category_ids = np.array([c.id for c in truth.vocabulary.categories], np.int64)
    truths = _truths(truth, image_ids, category_ids, protocol)
    detections, n_over_cap = _detections(
        truth, predictions.entries, image_ids, category_ids, truths, protocol
    )
    return Problem(
        protocol=protocol,
        image_ids=image_ids,
        category_ids=category_ids,
        detections=detections,
        truths=truths,
        n_over_cap=n_over_cap,
        n_unverified=int((~detections.verified).sum()),
    )


def _truths(
    truth: Truth, image_ids: Ints, category_ids: Ints, protocol: DetectionProtocol
) -> TrueInstances:
    image = _positions(image_ids, [a["image_id"] for a in truth.annotations])
    category = _positions(category_ids, [a["category_id"] for a in truth.annotations])
    area = np.array([a["area"] for a in truth.annotations], np.float64)
    crowd = np.array([bool(a.get("iscrowd", 0)) for a in truth.annotations], bool)
    ignored = np.array([bool(a.get("ignore", 0)) for a in truth.annotations], bool)
    if protocol.federated:
        crowd[:] = False  # lvis compares every mask by IoU
    elif not protocol.payload.own_ignore:
        ignored = crowd  # cocoeval overwrites `ignore` with `iscrowd`
    order = np.argsort(image, kind="stable")
    if protocol.federated:
        order = order[area[order] > 0]  # lvis loads annotations by area > 0
    return TrueInstances(
        image=image[order],
        category=category[order],
        area=area[order],
        ignored=ignored[order],
        crowd=crowd[order],
        annotation=order,
    )


def _detections(
    truth: Truth,
    entries: PredictionColumns,
    image_ids: Ints,
    category_ids: Ints,
    truths: TrueInstances,
    protocol: DetectionProtocol,
) -> tuple[Detections, int]:
    image = _positions(image_ids, entries.image_id)
    category = _positions(category_ids, entries.category_id)
    score = entries.score.astype(np.float64)
    place = np.arange(len(score))
    kept = np.ones(len(score), bool)
    if protocol.per_image_cap is not None:
        by_image = np.lexsort((place, -score, image))
        kept[by_image] = rank_in_group(image[by_image]) < protocol.per_image_cap
    order = np.lexsort((place, -score, category, image))
    order = order[kept[order]]
    rank = rank_in_group(image[order] * len(category_ids) + category[order])
    if protocol.per_category_cap is not None:
        within = rank < protocol.per_category_cap
        order, rank = order[within], rank[within]
    cell = image[order] * len(category_ids) + category[order]
    verified, exhaustive = _apply_federation(truth, cell, category_ids, truths, protocol)
    return Detections(
        image=image[order],
        category=category[order],
        score=score[order],
        rank=rank,
        entry=order,
        verified=verified,
        exhaustive=exhaustive,
    ), len(score) - len(order)


def _apply_federation(
    truth: Truth, cell: Ints, category_ids: Ints, truths: TrueInstances, protocol: DetectionProtocol
) -> tuple[Bools, Bools]:
    """Which detections (by image * n_categories + category) are verified and exhaustive."""
    if not protocol.federated:
        return np.ones(len(cell), bool), np.ones(len(cell), bool)
    n = len(category_ids)
    negative = _cells(truth, "neg_category_ids", category_ids)
    partial = _cells(truth, "not_exhaustive_category_ids", category_ids)
    present = truths.image * n + truths.category
    return np.isin(cell, present) | np.isin(cell, negative), ~np.isin(cell, partial)


def _cells(truth: Truth, key: str, category_ids: Ints) -> Ints:
    """image * n_categories + category for an LVIS image's list of category ids."""
    known = set(category_ids.tolist())
    pairs = [(i, c) for i, image in enumerate(truth.images) for c in image[key] if c in known]
    if not pairs:
        return np.empty(0, np.int64)
    images, categories = np.array(pairs, np.int64).T
    cells: Ints = images * len(category_ids) + _positions(category_ids, categories)
    return cells


def _positions(sorted_ids: Ints, ids: ArrayLike) -> Ints:
    positions: Ints = np.searchsorted(sorted_ids, np.asarray(ids, np.int64)).astype(np.int64)
    return positions
