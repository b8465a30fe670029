"""What hangs on a wall and what floats, on boxes whose distances are known without FCL."""

from __future__ import annotations

import numpy as np
import pytest
from plugin.live_room import shift

from legoworld.plugin.entities import Entities
from legoworld.plugin.measure import measure
from legoworld.records.plugin_requirements import Touching

pytestmark = pytest.mark.blender

WH = (160, 120)


def boxes_apart(shot, name, others):
    """The least distance of axis-aligned boxes, from their corners alone."""
    entities = Entities(shot)
    own = entities.points_m(name)
    low, high = own.min(axis=0), own.max(axis=0)
    gaps = []
    for other in others:
        points = entities.points_m(other)
        apart = np.maximum(0, np.maximum(points.min(axis=0) - high, low - points.max(axis=0)))
        gaps.append(float(np.linalg.norm(apart)))
    return min(gaps)


def ask(scene, **fields):
    (result,) = measure(scene, [Touching(**fields)], None, size_wh=WH).results
    return result


@pytest.mark.parametrize(
    ("by_m", "on", "metres", "verdict"),
    [
        ((0, 0, 0), "Table", 0.0, "pass"),
        ((0, 0, 0.009), "Table", 0.009, "pass"),
        ((0, 0, 0.03), "Table", 0.03, "fail"),
        ((0, 0, 0.03), None, 0.03, "fail"),
        ((0, 0, 0), "Floor", 0.75, "fail"),
        ((1.1 + 0.3, 0, -0.25), "Table", 0.3, "fail"),  # beside the table, as on a wall
        ((1.1 + 0.005, 0, -0.25), "Table", 0.005, "pass"),
        ((1.1 + 0.3, 0.6 + 0.4, -0.25), "Table", 0.5, "fail"),  # off its edge: 3, 4, 5
    ],
)
def test_the_distance_is_that_of_the_boxes(live, by_m, on, metres, verdict):
    scene = shift(live("none"), "Cup", by_m)
    result = ask(scene, entity="Cup", on=on)
    assert result.measurement == result.residual == pytest.approx(metres, abs=1e-6)
    assert result.verdict == verdict
    others = [on] if on else ["Table", "Floor", "Chair", "Crate"]
    assert result.measurement == pytest.approx(boxes_apart(scene.snapshot, "Cup", others), abs=1e-6)


def test_an_entity_alone_touches_nothing(live):
    result = ask(live("none"), entity="Crate", on="Lid")  # the lid is a part of it
    assert (result.verdict, result.residual) == ("fail", None)
    assert "nothing else" in result.reason
