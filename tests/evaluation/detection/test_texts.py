"""Texts kept as one piece of memory are the sequence that they were made of."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from legoworld.evaluation.detection.inputs.masks import TextBuilder, pack_texts

WORDS = ["", "abc", "\u00e9\u20ac", "", "x" * 300, "\ud800half", "end"]


def test_they_are_the_sequence():
    texts = pack_texts(iter(WORDS))
    assert len(texts) == len(WORDS)
    assert list(texts) == WORDS
    assert [texts[i] for i in range(len(WORDS))] == WORDS
    for some in (slice(None), slice(2, 5), slice(-2, None), slice(None, None, -2), slice(9, 12)):
        assert texts[some] == WORDS[some]
    assert len(pack_texts([])) == 0
    assert list(pack_texts([])) == []


def test_those_at_some_places(monkeypatch):
    texts = pack_texts(WORDS)
    for block in (1, 2, 1 << 20):
        monkeypatch.setattr("legoworld.evaluation.detection.inputs.masks._BLOCK", block)
        places = np.array([6, 1, 1, 5, 0, 2], np.int64)
        assert list(texts.take(places)) == [WORDS[k] for k in places]
        assert list(texts.take(places[:0])) == []


@pytest.mark.parametrize(("first", "end"), [(0, 7), (1, 3), (4, 4), (6, 7)])
def test_a_piece_of_them(first, end):
    data, start = pack_texts(WORDS).piece(first, end)
    assert start[0] == 0
    found = [data[a:b].decode("utf-8", "surrogatepass") for a, b in pairwise(start)]
    assert found == WORDS[first:end]
    assert len(data) == start[-1]


def test_what_is_added_in_parts_is_the_same():
    built = TextBuilder()
    built.add(WORDS[:2])
    built.add([])
    built.add(iter(WORDS[2:4]))
    built.add_encoded([word.encode("utf-8", "surrogatepass") for word in WORDS[4:]])
    assert list(built.texts()) == WORDS
