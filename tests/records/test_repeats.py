"""Repeated names are found by looking at each once: messages about them stay linear."""

from __future__ import annotations

import pytest
from scene.by_hand import HandScene

from legoworld.errors import CatalogError
from legoworld.records.base import find_repeated
from legoworld.scene import labels
from legoworld.tracks.track import TrackImage, _refuse_duplicates
from legoworld.tracks.vocabulary import from_json


class Counted(str):
    """A name that counts how often it is compared."""

    compared = 0

    def __eq__(self, other):
        Counted.compared += 1
        return str.__eq__(self, other)

    __hash__ = str.__hash__


@pytest.fixture(autouse=True)
def count_from_zero():
    Counted.compared = 0


def names(count):
    return [Counted(f"name {i}") for i in range(count)]


def test_the_repeated_ones_in_the_order_they_were_first_met():
    assert find_repeated("abcacbxa") == ["a", "b", "c"]
    assert find_repeated([]) == find_repeated([3, 1, 2]) == []


COUNT = 2000


def test_repeated_values_are_found_with_a_look_at_each():
    assert find_repeated([*names(COUNT), Counted("name 1999")]) == ["name 1999"]
    assert Counted.compared < 3 * COUNT


def test_a_track_with_an_image_twice_is_refused_with_a_look_at_each():
    images = [
        TrackImage(id=i, file_name=name, scene=name, size_wh=None)
        for i, name in enumerate([*names(COUNT), Counted("name 1999")])
    ]
    with pytest.raises(CatalogError, match="file_name 'name 1999'"):
        _refuse_duplicates(images, "track.json")
    assert Counted.compared < 5 * COUNT


def test_a_vocabulary_with_a_name_twice_names_it():
    entries = [{"id": i, "name": f"name {i}"} for i in range(5)]
    with pytest.raises(CatalogError, match="name 3"):
        from_json([*entries, {"id": 5, "name": "name 3"}], "the list")


def test_labels_find_their_owners_with_a_look_at_each():
    scene = HandScene()
    for name in names(300):
        scene.object(name)
    scene.occurs("name 0")
    snapshot = scene.snapshot()
    outside = tuple(
        labels.OutsideLabel(kind="object", name=name, categories={"category": "chair"})
        for name in names(300)
    )
    Counted.compared = 0
    resolved = labels.resolve_labels(snapshot, outside, None, None)
    assert len(resolved.objects) == 300
    assert Counted.compared < 10 * 300
