"""Compiled matching, pairing and overlaps of masks, bit for bit against an image at a time."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from evaluation import reference_matching
from evaluation.detection_runs import checked, random_predictions, random_truth, text_counts
from evaluation.made_chunks import chunk_of
from pycocotools import mask as coco_mask

from legoworld.evaluation.detection.inputs.masks import areas_px
from legoworld.evaluation.detection.matching.chunks import Chunk, Chunks
from legoworld.evaluation.detection.matching.compiled_matching import (
    pairs_of_chunk,
    states_of_chunk,
)
from legoworld.evaluation.detection.matching.overlaps import Overlaps, overlaps_of
from legoworld.evaluation.detection.problem import build_problem


def assert_same(chunk: Chunk, overlaps: Overlaps) -> tuple[np.ndarray, int]:
    """Compiled and reference; (states, pairs) seen, so that a caller knows what it tried."""
    state = states_of_chunk(chunk, overlaps)
    expected = reference_matching.states(chunk, overlaps.iou, overlaps.area)
    np.testing.assert_array_equal(state, expected)
    n = 0
    for aware in (True, False):
        found, counted = reference_matching.pairs(chunk, overlaps.iou, class_aware=aware)
        pairs = pairs_of_chunk(chunk, overlaps, class_aware=aware)
        columns = pairs.detection.tolist(), pairs.truth.tolist(), pairs.iou.tolist()
        assert list(zip(*columns, strict=True)) == found
        np.testing.assert_array_equal(pairs.counted, counted)
        n += len(found)
    return state, n


@pytest.mark.parametrize("levels", [3, 8, None])
@pytest.mark.parametrize("odd", [0.0, 0.3])
def test_made_up_overlaps_full_of_ties(levels, odd):
    """Equal overlaps decide who takes whom: the later truth, and what scipy takes."""
    random = np.random.default_rng([levels or 0, int(10 * odd)])
    kinds, paired = set(), 0
    for _ in range(60):
        sizes = random.integers(0, [[14, 7]] * 6)
        found = [sorted(random.integers(0, 3, n).tolist()) for n, _ in sizes]
        wanted = [random.integers(0, 3, n).tolist() for _, n in sizes]
        chunk = chunk_of(found, wanted, random, odd)
        n = int(sizes.prod(axis=1).sum())
        grid = np.array([0.0, 0.5, 0.95, 0.3, 0.75, 0.7500001, 0.8, 1.0])
        iou = random.random(n) if levels is None else random.choice(grid[:levels], n)
        area = random.choice([0.0, 1024.0, 1e4], len(chunk.detections.image))
        state, n_pairs = assert_same(chunk, Overlaps(iou=iou, area=area))
        kinds |= set(state.ravel().tolist())
        paired += n_pairs
    assert kinds == {0, 1, 2}
    assert paired > 500


@pytest.mark.parametrize("task", ["coco", "coco-masks", "lvis"])
@pytest.mark.parametrize("seed", range(4))
def test_tracks_with_crowds_areas_and_gaps(task, seed, tmp_path, monkeypatch):
    monkeypatch.setattr("legoworld.evaluation.detection.matching.chunks._CHUNK_DETECTIONS", 30)
    document = random_truth(task, seed=seed, images=25, per_image=8)
    predictions = random_predictions(task, document, seed=seed, per_image=20, levels=5)
    protocol, truth, predictions = checked(tmp_path, task, document, predictions)
    problem = build_problem(truth, predictions, protocol)
    chunks = Chunks(problem, truth, predictions)
    assert len(chunks) > 5
    for k in range(len(chunks)):
        chunk = chunks[k]
        overlaps = overlaps_of(chunk)
        iou, area = reference_matching.overlaps(chunk)
        np.testing.assert_array_equal(overlaps.iou, iou)
        np.testing.assert_array_equal(overlaps.area, area)
        assert_same(chunk, overlaps)


def blobs(random, size_hw):
    """Pixels of a few rectangles, or none, or all; with runs from end to end of the image."""
    pixels = np.zeros(size_hw, np.uint8, order="F")
    for _ in range(random.integers(0, 4)):
        top, left = random.integers(0, size_hw)
        pixels[top : top + random.integers(1, 20), left : left + random.integers(1, 20)] = 1
    return 1 - pixels if random.random() < 0.1 else pixels


def test_overlaps_of_any_masks_are_those_of_pycocotools():
    random = np.random.default_rng(5)
    for _ in range(80):
        size_hw = tuple(random.integers(1, 40, 2).tolist())
        found, wanted = (
            [coco_mask.encode(blobs(random, size_hw)) for _ in range(random.integers(1, 9))]
            for _ in range(2)
        )
        chunk = chunk_of([[0] * len(found)], [[0] * len(wanted)], random, 0.4)
        texts = tuple(text_counts(m)["counts"] for m in found)
        masks = {"iou_type": "segm", "sizes_hw": (size_hw,), "masks": texts}
        chunk = Chunk(**{**vars(chunk), **masks, "true_masks": tuple(map(text_counts, wanted))})
        crowd = chunk.truths.crowd.astype(int).tolist()
        overlaps = overlaps_of(chunk)
        np.testing.assert_array_equal(overlaps.iou, coco_mask.iou(found, wanted, crowd).ravel())
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
        chunk = chunk_of([[0]], [[0]], np.random.default_rng(0), 0.0)
        shapes = {"masks": (text_counts(a)["counts"],), "true_masks": (text_counts(b),)}
        chunk = Chunk(**{**vars(chunk), "iou_type": "segm", "sizes_hw": (size_hw,), **shapes})
        assert overlaps_of(chunk).iou.tolist() == coco_mask.iou([a], [b], [0]).ravel().tolist()
