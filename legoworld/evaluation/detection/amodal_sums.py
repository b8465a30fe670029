"""Amodal masks besides AP: the invisible part, the visible fraction, hidden objects, order.

Sums of each image, from class-aware pairs at IoU 0.5, and their numbers as text.
docs/protocols/amodal.md defines them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.bootstrap import weighted_sums
from legoworld.evaluation.detection.inputs.masks import (
    EncodedMask,
    areas_px,
    compress_mask,
    intersection_px,
    union,
)
from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.matching.matched_metrics import HIT, Pairs
from legoworld.evaluation.detection.payloads.masks import MASKS
from legoworld.evaluation.detection.problem import Floats, Problem
from legoworld.evaluation.metrics import MetricPart, MetricRow, fraction, number_cell
from legoworld.records.base import number
from legoworld.records.detection import AmodalSums, DetectionSummary
from legoworld.records.evaluation import Values
from legoworld.tables.table import Table, table

#: Each number: a sum, divided by another or by the mean of two.
AMODAL_METRICS: Final = {
    "invisible_iou": ("invisible_iou_sum", "n_occluded"),
    "invisible_iou_matched": ("invisible_iou_sum", "n_occluded_matched"),
    "visible_fraction_error": ("fraction_error_sum", "n_matched"),
    "hidden_recall": ("n_hidden_matched", "n_hidden"),
    "order_precision": ("n_order_right", "n_order_predicted"),
    "order_recall": ("n_order_right", "n_order_truth"),
    "order_f1": ("n_order_right", "n_order_truth", "n_order_predicted"),
}
#: Masks whose overlaps with all others are found together.
_BLOCK: Final = 256
#: What numbers are over: sums of `AmodalSums`.
_OVER: Final = {
    "n_occluded": "annotations with hidden parts",
    "n_occluded_matched": "matched annotations with hidden parts",
    "n_matched": "matched annotations",
    "n_hidden": "wholly hidden annotations",
    "n_order_predicted": "predicted pairs",
    "n_order_truth": "true pairs",
}


class AmodalMasks(NamedTuple):
    """Masks of one image, and their pixels: (n,)."""

    amodal: list[EncodedMask]
    visible: list[EncodedMask]
    amodal_px: Floats
    visible_px: Floats

    def in_front(self) -> set[tuple[int, int]]:
        """Pairs (i, j), i in front of j: i is seen in more pixels of j than j in pixels of i.

        The rule of Zhan et al. (CVPR 2020), without an order where both are equal.
        """
        n, pixels = len(self.amodal), dict[tuple[int, int], int]()
        for first in range(0, n, _BLOCK):
            block = self.visible[first : first + _BLOCK]
            share = MASKS.compare_shapes(block, self.amodal, [1] * n)  # of the visible masks
            counts = np.rint(share * self.visible_px[first : first + _BLOCK, None])
            for i, j in np.argwhere(counts > 0).tolist():
                pixels[first + i, j] = int(counts[i, j])
        return {
            (i, j) for (i, j), count in pixels.items() if i != j and count > pixels.get((j, i), 0)
        }


def amodal_masks(pairs: Iterable[tuple[EncodedMask, EncodedMask]]) -> AmodalMasks:
    """pairs: amodal and visible; visible pixels outside of the first are added to it."""
    both = [(union([amodal, visible]), visible) for amodal, visible in pairs]
    amodal, visible = [a for a, _ in both], [v for _, v in both]
    return AmodalMasks(amodal, visible, areas_px(amodal), areas_px(visible))


def true_masks(truth: Truth) -> list[tuple[EncodedMask, EncodedMask]]:
    """Amodal and visible mask of every annotation."""
    sizes_hw = {i["id"]: (i["height"], i["width"]) for i in truth.images}

    def mask(annotation: Mapping[str, object], key: str) -> EncodedMask:
        return compress_mask(annotation[key], sizes_hw[annotation["image_id"]])

    return [(mask(a, "segmentation"), mask(a, "visible_mask")) for a in truth.annotations]


def image_sums(
    problem: Problem,
    predictions: Predictions,
    pairs: Pairs,
    true: Sequence[tuple[EncodedMask, EncodedMask]],
) -> Iterator[AmodalSums]:
    """The sums of each image, ascending id. Crowds and ignored truths take no part."""
    entries, truths = predictions.entries, problem.truths
    assert entries.visible is not None
    assert entries.sizes_wh is not None
    hits = np.flatnonzero(pairs.iou >= HIT)
    found = dict(zip(pairs.truth[hits].tolist(), pairs.detection[hits].tolist(), strict=True))
    edges = np.searchsorted(truths.image, np.arange(len(problem.image_ids) + 1)).tolist()
    for k, image_id in enumerate(problem.image_ids.tolist()):
        own = [t for t in range(edges[k], edges[k + 1]) if not truths.ignored[t]]
        width, height = entries.sizes_wh[image_id]
        size = height, width
        places = problem.detections.entry[[found[t] for t in own if t in found]].tolist()
        yield _sums(
            amodal_masks(true[a] for a in truths.annotation[own].tolist()),
            amodal_masks(
                (_encode_mask(size, entries.shape[p]), _encode_mask(size, entries.visible[p]))
                for p in places
            ),
            [place for place, t in enumerate(own) if t in found],
        )


def _encode_mask(size_hw: tuple[int, int], counts: object) -> EncodedMask:
    return {"size": size_hw, "counts": str(counts).encode("ascii")}


def _sums(truth: AmodalMasks, matched: AmodalMasks, places: list[int]) -> AmodalSums:
    """places: of the truths that the matched predictions belong to."""
    occluded = truth.amodal_px > truth.visible_px
    hidden = (truth.visible_px == 0) & (truth.amodal_px > 0)
    errors = [
        abs(matched.visible_px[p] / matched.amodal_px[p] - truth.visible_px[t] / truth.amodal_px[t])
        for p, t in enumerate(places)
    ]
    invisible = [_invisible_iou(matched, p, truth, t) for p, t in enumerate(places) if occluded[t]]
    true_order = truth.in_front()
    order = {(places[i], places[j]) for i, j in matched.in_front()}
    return AmodalSums(
        n_matched=len(places),
        fraction_error_sum=float(sum(errors)),
        n_occluded=int(occluded.sum()),
        n_occluded_matched=len(invisible),
        invisible_iou_sum=float(sum(invisible)),
        n_hidden=int(hidden.sum()),
        n_hidden_matched=int(hidden[places].sum()),
        n_order_truth=len(true_order),
        n_order_predicted=len(order),
        n_order_right=len(order & true_order),
    )


def _invisible_iou(one: AmodalMasks, i: int, other: AmodalMasks, j: int) -> float:
    """IoU of what is not visible of two masks, by inclusion and exclusion."""
    a, v, b, w = one.amodal[i], one.visible[i], other.amodal[j], other.visible[j]
    shared = intersection_px(a, b) - intersection_px(a, w) - intersection_px(v, b)
    shared += intersection_px(v, w)
    areas = one.amodal_px[i] - one.visible_px[i] + other.amodal_px[j] - other.visible_px[j]
    return float(shared / (areas - shared))


def amodal_metrics(
    sums: Sequence[AmodalSums], samples: NDArray[np.int32]
) -> dict[str, NDArray[np.float64]]:
    """Every number of every sample of images: (n,), NaN where undefined."""

    def total(name: str) -> NDArray[np.float64]:
        return weighted_sums(samples, np.array([getattr(one, name) for one in sums]))

    with np.errstate(invalid="ignore", divide="ignore"):
        return {
            name: total(counted) / np.mean([total(one) for one in of], axis=0)
            for name, (counted, *of) in AMODAL_METRICS.items()
        }


def amodal_values(sums: Sequence[AmodalSums]) -> Values:
    """Every number over all images."""
    whole = amodal_metrics(sums, np.ones((1, len(sums)), np.int32))
    return {name: number(float(value[0])) for name, value in whole.items()}


def total_sums(sums: Sequence[AmodalSums]) -> AmodalSums:
    """The sums over all images."""
    names = AmodalSums.__struct_fields__
    return AmodalSums(**{name: sum(getattr(one, name) for one in sums) for name in names})


def short_amodal(summary: DetectionSummary) -> list[str]:
    """The controls in a line, and what the invisible part scores."""
    if not summary.amodal:
        return []
    controls = summary.amodal.controls
    if not controls:
        return ["no visible masks: no controls, and no number of hidden parts"]
    beside = ", ".join(f"{name} {fraction(one['AP'])}" for name, one in controls.items())
    invisible = fraction(summary.amodal.metrics["invisible_iou"])
    return [f"controls to beat, AP: {beside}; IoU of the invisible part {invisible}"]


def amodal_part(summary: DetectionSummary) -> Iterator[MetricPart]:
    """What AP hides, with intervals."""
    if summary.amodal and summary.amodal.sums:
        rows = []
        for name, value in summary.amodal.metrics.items():
            keys = AMODAL_METRICS[name][1:]
            over = ", ".join(f"{getattr(summary.amodal.sums, k)} {_OVER[k]}" for k in keys)
            shown = number_cell(value, summary.intervals.get(f"amodal.{name}"))
            rows.append(MetricRow(name=f"amodal.{name}", number=shown, over=over))
        yield MetricPart(
            title="Amodal masks: what AP hides",
            rows=rows,
            note="Of pairs within a category at IoU 0.5. visible_fraction_error: lower is better.",
        )


def amodal_tables(summary: DetectionSummary) -> list[Table]:
    """By occlusion, and every number beside those of the controls."""
    if not summary.amodal:
        return []
    levels, controls = summary.amodal.levels, summary.amodal.controls
    own = {**summary.metrics, **summary.amodal.metrics}
    names = list(levels["none"].metrics)
    by_level = table(
        ("hidden", *names, "annotations"),
        [
            (name, *(number_cell(level.metrics[n]) for n in names), level.truth_instances)
            for name, level in levels.items()
        ],
        title="By the hidden share of the annotation",
        notes=("partial: up to a quarter; heavy: more. Annotations of other rows are ignored.",),
    )
    beside = table(
        ("metric", "run", *controls),
        [
            (name, number_cell(own[name]), *(number_cell(one[name]) for one in controls.values()))
            for name in next(iter(controls.values()), {})
        ],
        title="Controls: amodal masks replaced by the visible ones, or by their convex hulls",
        notes=("A result has to beat both.",),
    )
    return [by_level, *[beside] * bool(controls)]
