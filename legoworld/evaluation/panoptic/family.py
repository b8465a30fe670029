"""Panoptic quality: the matches of an image in integers, and PQ, SQ, RQ of their sums.

Segments as a family of evaluations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.evaluation.label_maps.family import (
    F64,
    Counts,
    MapFamily,
    MapInvalidError,
    MapItem,
    MapTruthError,
    Measured,
    average_defined,
    ratio,
)
from legoworld.evaluation.label_maps.png import check_size, label_map_view, read_ids, shrink_map
from legoworld.evaluation.label_maps.text import map_evaluation
from legoworld.evaluation.panoptic.truth import TrueSegments, find_segments
from legoworld.pluralize import plural
from legoworld.readouts.label_maps import VOID, agreement_picture, segment_picture
from legoworld.records.coco_file import SegmentInfo
from legoworld.records.label_maps import LabelMapSummary, MatchedSegment
from legoworld.records.run_rows import Segment
from legoworld.tasks.shipped import PANOPTIC

METRICS: Final = tuple(
    f"{name}{group}" for group in ("", "_things", "_stuff") for name in ("PQ", "SQ", "RQ")
)
#: Pairs of segments up to this many have a table of counts.
_TABLE: Final = 1 << 22
Ids = NDArray[np.int64]
AnySegment = Segment | SegmentInfo


def measure_segments(item: MapItem) -> Measured:
    """An image's matches, false positives and false negatives; without an answer all is VOID."""
    truth: TrueSegments = item.truth
    true_ids = read_ids(truth.path, MapTruthError)
    true_place = places(true_ids, truth.segments, truth.path.name, MapTruthError)
    _check_areas(true_place, truth)
    n_truth = sum(not segment.iscrowd for segment in truth.segments)
    place, segments = np.zeros_like(true_place), item.row.segments or ()
    if item.path is None:
        segments = ()
    else:
        ids = read_ids(item.path, MapInvalidError)
        check_size(item.path, ids, true_ids.shape, MapInvalidError)
        place = check_answer(ids, segments, item.category_ids, item.path.name)
    counts, matched = count_segments(true_place, place, truth.segments, segments)
    small_true, small = shrink_map(true_place), shrink_map(place)
    of_true, of = _listed_categories(truth.segments), _listed_categories(segments)
    true_category, category = (np.array([VOID, *ids]) for ids in (of_true, of))
    view = label_map_view(
        true_ids.shape,
        truth=segment_picture(small_true, of_true),
        answer=segment_picture(small, of),
        agreement=agreement_picture(true_category[small_true], category[small], small_true > 0),
    )
    return Measured(n_truth=n_truth, counts=counts, matched=matched, view=view)


def check_answer(
    ids: NDArray[Any], segments: Sequence[AnySegment], category_ids: Sequence[int], name: str
) -> Ids:
    """(H, W) `places` of an answer that the official script would take, else MapInvalidError."""
    place = places(ids, segments, name, MapInvalidError)
    seen = np.bincount(place.ravel(), minlength=len(segments) + 1)[1:]
    ordered = sorted(segments, key=lambda segment: segment.id)
    unseen = [segment.id for segment, pixels in zip(ordered, seen, strict=True) if not pixels]
    unknown = sorted({segment.category_id for segment in segments} - {*category_ids})
    if unseen or unknown:
        raise MapInvalidError(
            f"{name} and its segments_info do not fit together",
            found=f"segment {unseen[0]} in the JSON file alone"
            if unseen
            else f"category_id {unknown[0]}",
            expected="the ids of the PNG, and categories of the vocabulary",
        )
    return place


def places(
    ids: NDArray[Any], segments: Sequence[AnySegment], name: str, error: type[LegoWorldError]
) -> Ids:
    """(H, W): 1 + the place of each pixel's id among the sorted ids of segments, 0 for VOID.

    The error for an id of the PNG that no segment has.
    """
    known = np.array([VOID, *sorted(segment.id for segment in segments)], ids.dtype)
    flat = ids.ravel()
    starts = np.concatenate([[0], np.flatnonzero(flat[1:] != flat[:-1]) + 1])
    runs, lengths = flat[starts], np.diff(starts, append=flat.size)
    found = np.minimum(np.searchsorted(known, runs), len(known) - 1)
    strange = known[found] != runs
    if strange.any():
        raise error(
            f"{name} has segments that are not in the JSON file",
            found=f"id {int(runs[strange].min())} on {int(lengths[strange].sum())} pixels",
            expected="0 for VOID, or an id of segments_info",
        )
    return np.repeat(found, lengths).reshape(ids.shape)


def count_segments(
    true_place: Ids,
    place: Ids,
    true_segments: Sequence[SegmentInfo],
    segments: Sequence[AnySegment],
) -> tuple[Counts, tuple[MatchedSegment, ...]]:
    """TP, FP, FN of each category, and the matches by ids of truth and answer.

    A match: one category, IoU above 1/2, the union without the answer's pixels on VOID; a crowd
    never matches. An unmatched answer with more than half of its pixels on VOID and the crowd of
    its category does not count; of several crowds of a category the one listed last is that crowd.
    Places: (H, W).
    """
    truths = sorted(true_segments, key=lambda segment: segment.id)
    answers = sorted(segments, key=lambda segment: segment.id)
    rows, cols, shared = _pairs(true_place, place, len(truths) + 1, len(answers) + 1)
    pixels = np.bincount(place.ravel(), minlength=len(answers) + 1).tolist()
    both = {
        (t, p): n for t, p, n in zip(rows.tolist(), cols.tolist(), shared.tolist(), strict=True)
    }
    matched: list[MatchedSegment] = []
    for (t, p), intersection in both.items():
        if not t or not p:
            continue
        truth, answer = truths[t - 1], answers[p - 1]
        if truth.iscrowd or truth.category_id != answer.category_id:
            continue
        union = pixels[p] + truth.area - intersection - both.get((0, p), 0)
        if 2 * intersection > union:
            matched.append(
                MatchedSegment(
                    category_id=truth.category_id,
                    truth=truth.id,
                    answer=answer.id,
                    intersection=intersection,
                    union=union,
                )
            )
    hit, met = {m.truth for m in matched}, {m.answer for m in matched}
    crowds = {s.category_id: s.id for s in true_segments if s.iscrowd}
    crowd_place = {t.id: at for at, t in enumerate(truths, start=1)}
    missed = [t.category_id for t in truths if not t.iscrowd and t.id not in hit]
    false = []
    for at, answer in enumerate(answers, start=1):
        ignored = both.get((0, at), 0)
        if answer.category_id in crowds:
            ignored += both.get((crowd_place[crowds[answer.category_id]], at), 0)
        if answer.id not in met and 2 * ignored <= pixels[at]:
            false.append(answer.category_id)
    found = [m.category_id for m in matched]
    every = {*found, *false, *missed}
    return {c: (found.count(c), false.count(c), missed.count(c)) for c in every}, tuple(matched)


def _check_areas(true_place: Ids, truth: TrueSegments) -> None:
    """MapTruthError where the JSON file declares another area than the PNG has."""
    seen = np.bincount(true_place.ravel(), minlength=len(truth.segments) + 1)[1:].tolist()
    ordered = sorted(truth.segments, key=lambda segment: segment.id)
    for segment, pixels in zip(ordered, seen, strict=True):
        if segment.area != pixels:
            raise MapTruthError(
                f"a segment of {truth.path.name} has another area than its file says",
                found=f"segment {segment.id}: {pixels} pixels",
                expected=f"{segment.area}, as in segments_info",
            )


def _pairs(true_place: Ids, place: Ids, n_true: int, n: int) -> tuple[Any, Any, Any]:
    """The pairs of places that share pixels, by truth and answer, and how many they share."""
    code = true_place.ravel() * n + place.ravel()
    if n_true * n <= _TABLE:
        shared = np.bincount(code, minlength=n_true * n)
        pairs = np.flatnonzero(shared)
        return pairs // n, pairs % n, shared[pairs]
    pairs, shared = np.unique(code, return_counts=True)
    return pairs // n, pairs % n, shared


def _listed_categories(segments: Sequence[AnySegment]) -> list[int]:
    """Category ids in the order of `places`."""
    return [s.category_id for s in sorted(segments, key=lambda segment: segment.id)]


def panoptic_values(sums: F64, things: NDArray[np.bool_]) -> dict[str, F64]:
    """PQ, SQ and RQ of sums (..., K, 4): over all, things, and stuff categories."""
    of, defined = category_values(sums), sums[..., 1:].sum(axis=-1) > 0
    groups = {"": np.ones_like(things), "_things": things, "_stuff": ~things}
    return {
        f"{name}{group}": average_defined(of[name], defined & kept)
        for group, kept in groups.items()
        for name in ("PQ", "SQ", "RQ")
    }


def category_values(sums: F64) -> dict[str, F64]:
    """PQ, SQ and RQ of each category, (..., K) from (..., K, 4), as panopticapi computes them."""
    iou, tp, fp, fn = (sums[..., k] for k in range(4))
    weight = tp + 0.5 * fp + 0.5 * fn
    squares = np.where(tp > 0, ratio(iou, tp), 0.0)
    return {"PQ": ratio(iou, weight), "SQ": squares, "RQ": ratio(tp, weight)}


MAPS: Final = MapFamily(
    family=PANOPTIC,
    noun="segments",
    metrics=METRICS,
    headline=("PQ", "PQ_things", "PQ_stuff"),
    find_truth=find_segments,
    measure=measure_segments,
    values=panoptic_values,
    category_values=category_values,
    columns=("TP", "FP", "FN"),
    note="PQ = SQ x RQ of each category, averaged over the categories with truth or prediction: "
    "the IoU of matches, summed, divided by (TP + FP/2 + FN/2). A match has IoU above 0.5. An "
    "image without an answer is all VOID.",
)


def _over(summary: LabelMapSummary, name: str) -> str:
    wanted = {"things": (True,), "stuff": (False,)}.get(name.partition("_")[2], (True, False))
    counted = [c for c in summary.categories if c.isthing in wanted]
    true = sum(c.counts[0] + c.counts[2] for c in counted)
    categories = plural(len(counted), "category", "categories")
    return f"{categories}, {plural(true, 'true segment', 'true segments')}"


EVALUATION: Final = map_evaluation(MAPS, _over)
