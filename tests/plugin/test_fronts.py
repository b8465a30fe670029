"""Which way an object faces."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from solids.boxes import about

from legoworld.plugin.measure_world import UnknownError, WorldMeasurement


def fronts(child_turn):
    """An empty turned by 90 degrees, with a mesh below it that is turned by itself."""
    quarter, still = np.eye(4), np.eye(4).ravel()
    quarter[:3, :3] = about((0, 0, 1), 90)
    turned = quarter[:3, :3] @ child_turn
    snapshot = SimpleNamespace(
        objects=[
            SimpleNamespace(name="Chair", library=None, parent=-1),
            SimpleNamespace(name="Seat", library=None, parent=0),
            SimpleNamespace(name="Pivot", library=None, parent=0),
        ],
        occurrence_object=np.array([1]),
        occurrence_instancer=np.array([-1]),
        surface_occurrence=np.array([0]),
        world_from_mesh=np.hstack([turned, np.zeros((3, 1))])[None],
    )
    transforms = {"Chair": [*quarter.ravel(), *still], "Seat": [*still, *still]}
    transforms["Pivot"] = [*quarter.ravel(), *quarter.ravel()]
    states = [SimpleNamespace(name=n, library=None, transform=t) for n, t in transforms.items()]
    scene = SimpleNamespace(snapshot=snapshot, state=SimpleNamespace(objects=states))
    return {name: WorldMeasurement(scene)._front(name) for name in transforms}


@pytest.mark.parametrize("degrees", [0, 90, 200])
def test_a_front_is_the_objects_own_whatever_its_children_do(degrees):
    turn = about((0, 0, 1), degrees)
    found = fronts(turn)
    assert found["Chair"] == pytest.approx((1, 0, 0))
    assert found["Seat"] == pytest.approx(turn @ (1, 0, 0))
    assert found["Pivot"] == pytest.approx((-1, 0, 0)), "parent, its inverse, its own"


def test_a_collection_has_no_front():
    scene = SimpleNamespace(snapshot=SimpleNamespace(objects=[]))
    with pytest.raises(UnknownError, match="'Chairs' is a collection"):
        WorldMeasurement(scene)._front("Chairs")
