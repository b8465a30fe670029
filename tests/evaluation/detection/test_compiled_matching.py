"""Compiled matching, pairing and overlaps of masks, bit for bit against an image at a time."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from evaluation import reference_matching
from evaluation.detection_runs import checked, random_predictions, random_truth, text_counts
from evaluation.made_chunks import chunk_of
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from pycocotools import mask as coco_mask
from strategies import blobs, chunks

from legoworld.evaluation.detection.inputs.masks import areas_px
from legoworld.evaluation.detection.matching.matches import (
    Chunk,
    Chunks,
    match_chunk_states,
    pair_chunk,
)
from legoworld.evaluation.detection.payloads.masks import MASKS
from legoworld.evaluation.detection.payloads.payload import Overlaps
from legoworld.evaluation.detection.problem import build_problem


def assert_same(chunk: Chunk, overlaps: Overlaps) -> tuple[np.ndarray, int]:
    """Compiled and reference; (states, pairs) seen, so that a caller knows what it tried."""
    state = match_chunk_states(chunk, overlaps)
    expected = reference_matching.states(chunk, overlaps.iou, overlaps.area)
    np.testing.assert_array_equal(state, expected)
    n = 0
    for aware in (True, False):
        found, counted = reference_matching.pairs(chunk, overlaps.iou, class_aware=aware)
        pairs = pair_chunk(chunk, overlaps, class_aware=aware)
        columns = pairs.detection.tolist(), pairs.truth.tolist(), pairs.iou.tolist()
        assert list(zip(*columns, strict=True)) == found
        np.testing.assert_array_equal(pairs.counted, counted)
        n += len(found)
    return state, n


def test_made_up_overlaps_full_of_ties():
    """Equal overlaps decide who takes whom: the later truth, and what scipy takes."""
    kinds, paired = set(), 0

    @settings(max_examples=100)
    @given(chunks())
    def law(made):
        nonlocal paired
        state, n_pairs = assert_same(*made)
        kinds.update(state.ravel().tolist())
        paired += n_pairs

    law()
    assert kinds == {0, 1, 2}
    assert paired > 500


@pytest.mark.parametrize("task", ["coco", "coco-masks", "lvis"])
@pytest.mark.parametrize("seed", range(4))
def test_tracks_with_crowds_areas_and_gaps(task, seed, tmp_path, monkeypatch):
    monkeypatch.setattr("legoworld.evaluation.detection.matching.matches._CHUNK_DETECTIONS", 30)
    document = random_truth(task, seed=seed, images=25, per_image=8)
    predictions = random_predictions(task, document, seed=seed, per_image=20, levels=5)
    protocol, truth, predictions = checked(tmp_path, task, document, predictions)
    problem = build_problem(truth, predictions, protocol)
    chunks = Chunks(problem, truth, predictions)
    assert len(chunks) > 5
    for k in range(len(chunks)):
        chunk = chunks[k]
        overlaps = chunk.payload.overlaps(chunk)
        iou, area = reference_matching.overlaps(chunk)
        np.testing.assert_array_equal(overlaps.iou, iou)
        np.testing.assert_array_equal(overlaps.area, area)
        assert_same(chunk, overlaps)


@settings(max_examples=60)
@given(st.data())
def test_overlaps_of_any_masks_are_those_of_pycocotools(data):
    size_hw = data.draw(st.tuples(st.integers(1, 39), st.integers(1, 39)))
    sides = st.lists(blobs(size_hw).map(coco_mask.encode), min_size=1, max_size=8)
    found, wanted = data.draw(sides), data.draw(sides)
    crowd = data.draw(arrays.arrays(bool, len(wanted)))
    chunk = chunk_of([[0] * len(found)], [[0] * len(wanted)], ignored=crowd, crowd=crowd)
    texts = tuple(text_counts(m)["counts"] for m in found)
    masks = {"payload": MASKS, "sizes_hw": (size_hw,), "shapes": texts}
    chunk = Chunk(**{**vars(chunk), **masks, "true_shapes": tuple(map(text_counts, wanted))})
    overlaps = chunk.payload.overlaps(chunk)
    expected = coco_mask.iou(found, wanted, crowd.astype(int).tolist()).ravel()
    np.testing.assert_array_equal(overlaps.iou, expected)
    np.testing.assert_array_equal(overlaps.area, areas_px(found))


def test_empty_runs_stop_an_overlap_where_pycocotools_stops():
    """Legal in the format, written by no encoder: 2 clear, 2 set, 0 clear, 0 set, 60 clear."""
    size_hw = (8, 8)
    counts = [
        [2, 2, 0, 0, 60],
        [2, 2, 0, 0, 0, 10, 50],
        [0, 9, 55],
        [4, 0, 0, 60],
        [0, 0, 4, 60],
    ]
    masks = [coco_mask.frPyObjects({"size": list(size_hw), "counts": c}, *size_hw) for c in counts]
    for a, b in itertools.product(masks, repeat=2):
        chunk = chunk_of([[0]], [[0]])
        shapes = {"shapes": (text_counts(a)["counts"],), "true_shapes": (text_counts(b),)}
        chunk = Chunk(**{**vars(chunk), "payload": MASKS, "sizes_hw": (size_hw,), **shapes})
        assert (
            chunk.payload.overlaps(chunk).iou.tolist()
            == coco_mask.iou([a], [b], [0]).ravel().tolist()
        )
