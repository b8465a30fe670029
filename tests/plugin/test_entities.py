"""What belongs to a name: an object's children and what they generate, a collection's objects."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from legoworld.plugin.entities import Entities

#: name, parent, collections
OBJECTS = [("Maker", -1, (0,)), ("Leaf", -1, (1,)), ("Child", 0, ()), ("Both", -1, (2,))]
COLLECTIONS = [("Garden", ()), ("Leaves", (0,)), ("Both", ())]
#: Object of each occurrence, and the occurrence that generates it.
OCCURS = [(0, -1), (1, 0), (1, 1), (2, -1), (3, -1), (1, -1)]


@pytest.fixture
def entities() -> Entities:
    shot: Any = SimpleNamespace(
        objects=[
            SimpleNamespace(name=name, parent=parent, collections=inside)
            for name, parent, inside in OBJECTS
        ],
        collections=[SimpleNamespace(name=name, parents=above) for name, above in COLLECTIONS],
        occurrence_object=np.array([row[0] for row in OCCURS]),
        occurrence_instancer=np.array([row[1] for row in OCCURS]),
        surface_occurrence=np.array([0, 1, 2, 3, 4, 5, 5]),
    )
    return Entities(shot)


@pytest.mark.parametrize(
    ("name", "surfaces"),
    [
        ("Maker", [0, 1, 2, 3]),  # its child, its leaf, and what that leaf generates
        ("Leaf", [1, 2, 5, 6]),
        ("Child", [3]),
        ("Garden", [0, 1, 2, 3, 5, 6]),  # Leaves lies in it
        ("Leaves", [1, 2, 5, 6]),
        ("Both", [4]),  # the object, not the collection
    ],
)
def test_what_belongs_to_a_name(entities, name, surfaces):
    assert np.flatnonzero(entities.surfaces(name)).tolist() == surfaces


def test_a_name_that_is_not_there_has_its_likes(entities):
    assert entities.surfaces("Leef") is None
    assert entities.nearest("Leef")[:2] == ["Leaf", "Leaves"]
