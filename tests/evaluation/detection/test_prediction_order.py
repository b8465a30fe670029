"""Columns of predictions: arrays give the order that the entries' own keys give."""

from __future__ import annotations

import numpy as np
import pytest

from legoworld.evaluation.detection.inputs.box_formats import finite_floats, is_finite
from legoworld.evaluation.detection.inputs.masks import pack_texts
from legoworld.evaluation.detection.inputs.prediction_columns import make_columns
from legoworld.evaluation.detection.inputs.prediction_order import canonical_key, in_order
from legoworld.files import canonical_json
from legoworld.records.base import to_record
from legoworld.records.predictions import Prediction


def entries(kind, random, n=300):
    """Few images, categories, shapes and scores, so that every key is tied; integers and floats."""
    whole = [(2**53) + k for k in range(3)]
    numbers = {"boxes": [0, 0.0, -0.0, 1, 1.5], "huge": [*whole, 2.0**53, 7]}
    found = []
    for _ in range(n):
        image_id, category_id, score = random.integers(1, 4, 3).tolist()
        entry = {"image_id": image_id, "category_id": category_id}
        entry["score"] = [1, 0.5, 1.0][score - 1]
        if kind == "masks":
            counts = "".join(random.choice(["0", "Z", "o", "a"], random.integers(1, 4)))
            entry["segmentation"] = {"size": [4, 5], "counts": counts}
        else:
            picked = random.integers(0, len(numbers[kind]), 4).tolist()
            entry["bbox"] = [numbers[kind][k] for k in picked]
        found.append(entry)
    return found


@pytest.mark.parametrize("kind", ["boxes", "masks", "huge"])
def test_ordered_by_arrays_as_by_keys(kind):
    given = entries(kind, np.random.default_rng(3))
    predictions = to_record(list[Prediction], given)
    found = in_order(make_columns(predictions), "canonical")
    assert repr([*found]) == repr(sorted(predictions, key=canonical_key))
    found = in_order(make_columns(predictions), "given")
    assert repr([*found]) == repr(sorted(predictions, key=lambda p: p.image_id))
    assert [repr(p) for p in found] == [repr(found[k]) for k in range(len(found))]
    ordered = sorted(given, key=lambda e: e["image_id"])
    assert list(map(canonical_json, found.documents())) == list(map(canonical_json, ordered))
    assert list(found.lines()) == list(map(canonical_json, ordered))


def test_results_share_nothing():
    boxes = make_columns(to_record(list[Prediction], entries("boxes", np.random.default_rng(0), 3)))
    boxes.results()[0]["bbox"].clear()
    assert [len(e["bbox"]) for e in boxes.results()] == [4, 4, 4]
    masks = make_columns(to_record(list[Prediction], entries("masks", np.random.default_rng(0), 3)))
    masks.results()[1]["segmentation"]["size"].clear()
    assert [e["segmentation"]["size"] for e in masks.results()] == [[4, 5]] * 3


def test_floats_are_found_where_each_value_is_one():
    values = [0, 1.5, -3, 1e308, 10**400, float("nan"), float("inf"), True, "1", None, [1]]
    for value in values:
        found = finite_floats([2, value])
        assert (found is not None) == is_finite(value), value
    assert finite_floats([]).shape == (0,)


def test_texts_in_one_piece_are_the_texts():
    texts = ["", "abc", "ü\u20ac", "\ud83d", "", "z" * 900]
    found = pack_texts(texts)
    assert list(found) == texts
    assert found[1:4] == texts[1:4]
    assert list(found.take(np.array([3, 0, 3]))) == [texts[3], "", texts[3]]
    assert list(pack_texts([])) == []
