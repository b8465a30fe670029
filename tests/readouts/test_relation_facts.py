"""Facts of boxes whose relations are known, and that they are the plugin's own measurements."""

from __future__ import annotations

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from readouts.cubes import FACES, view_of
from scene.by_hand import CAMERA

from legoworld.errors import InstallationError
from legoworld.plugin.measure_world import WorldMeasurement
from legoworld.readouts.family import AnsweredImage
from legoworld.readouts.relation_facts import relation_facts
from legoworld.readouts.relation_kinds import RELATIONS, FactBase
from legoworld.readouts.relations import READOUT
from legoworld.records.base import decode
from legoworld.records.plugin_requirements import Collision, Containment, Facing, Support
from legoworld.records.relations import AnswerFile
from legoworld.records.run_rows import RunRow
from legoworld.records.track import Designator


def base(*placed, **options) -> FactBase:
    return FactBase(relation_facts(*view_of(*placed, **options)))


def holding(facts: FactBase, a: int, b: int) -> set[str]:
    return {r for r in RELATIONS if (facts.margin(r, a, b) or 0) > 0}


@pytest.mark.parametrize("unit_scale", [1.0, 0.01])
def test_two_unit_cubes_side_by_side(unit_scale):
    facts = base(("cup", (0, 0, 5), 1), ("plate", (2, 0, 5), 1), unit_scale=unit_scale)
    assert facts.margin("left_of", 0, 1) == facts.margin("right_of", 1, 0) == 1.0
    assert facts.margin("left_of", 1, 0) == -1.0
    assert facts.margin("in_front_of", 0, 1) == 0.0
    assert facts.clear_answer("left_of", 0, 1) is True
    assert facts.clear_answer("left_of", 1, 0) is False
    assert facts.clear_answer("in_front_of", 0, 1) is facts.clear_answer("behind", 0, 1) is None
    pairs = facts.facts.pairs
    assert (pairs.centre_m, pairs.surface_m) == ((2.0,), (1.0,))
    assert pairs.near_m == (pytest.approx(3**0.5, abs=1e-6),)
    assert holding(facts, 0, 1) == {"left_of", "near"}


def test_a_cube_on_a_cube():
    facts = base(("cup", (0, 0, 5), 1), ("plate", (0, -1, 5), 1))
    assert facts.facts.pairs.gap_ba_m == (0.0,)
    assert facts.margin("on", 1, 0) == facts.margin("supports", 0, 1) == 0.01
    assert facts.clear_answer("on", 1, 0) is True
    assert facts.margin("on", 0, 1) == 0.0, "what carries does not rest on its load"
    assert holding(facts, 1, 0) == {"on", "over", "touching", "near", "hidden_by"}
    floating = base(("cup", (0, 0, 5), 1), ("plate", (0, -1.03, 5), 1))
    assert floating.margin("on", 1, 0) == pytest.approx(-0.02)
    assert floating.clear_answer("on", 1, 0) is None
    over_the_edge = base(("cup", (0, 0, 5), 1), ("plate", (0.7, -1, 5), 1))
    assert over_the_edge.margin("on", 1, 0) is None, "it touches, and would fall"
    assert over_the_edge.margin("on", 0, 1) is None


def test_the_picture_decides_what_is_left_where_depths_differ():
    """The far cube's extent is right of the near one's in metres, and left of it in the picture."""
    facts = base(("cup", (1, 0, 2), 0.5), ("plate", (2.5, 0, 10), 0.5))
    assert facts.margin("left_of", 1, 0) > 0
    assert facts.margin("in_front_of", 0, 1) == pytest.approx(7.5)


def test_an_orthographic_camera():
    from dataclasses import replace

    camera = replace(CAMERA, type="ORTHO", ortho_scale=8.0)
    facts = base(("cup", (0, 0, 5), 1), ("plate", (2, 0, 9), 1), camera=camera)
    assert facts.margin("left_of", 0, 1) == pytest.approx(1.0)


def test_what_is_inside_under_and_hidden():
    facts = base(("bowl", (0, 0, 6), 2), ("ball", (0, 0.5, 6), 0.5))
    assert facts.facts.objects[0].category == "bowl"
    assert len(facts.facts.objects) == 1, "what no pixel shows has no facts"
    facts = base(("cup", (0, 0, 8), 1), ("ball", (0.25, 0, 4), 0.5), ("cup", (0, 3, 8), 1))
    assert facts.objects[0].visible == pytest.approx(1 - facts.facts.pairs.hidden_ab[0], abs=1e-5)
    assert facts.margin("hides", 1, 0) > 0.1 > 0 > facts.margin("hides", 0, 1)
    assert facts.margin("under", 2, 0) == pytest.approx(1.0)
    assert facts.margin("over", 0, 2) == pytest.approx(1.0)


def test_what_a_closed_volume_holds_is_inside_and_what_only_a_hull_holds_is_undecided():
    """The camera is in the room, too."""
    placed = ("room", (0, 0, 0), 10), ("ball", (0, 0, 3), 0.5), ("cup", (0, 2, 6), 3)
    closed = base(*placed)
    assert closed.margin("inside", 1, 0) == closed.margin("contains", 0, 1) == pytest.approx(0.05)
    assert closed.margin("inside", 0, 1) == pytest.approx(-0.95)
    assert closed.margin("inside", 2, 0) == pytest.approx(-0.45), "half of it"
    without_a_wall = base(*placed, faces=FACES[1:])
    assert without_a_wall.margin("inside", 1, 0) is None
    assert without_a_wall.margin("inside", 2, 0) == pytest.approx(-0.45)


def test_things_that_reach_into_each_other_collide_by_the_plugin_s_depth():
    placed = ("cup", (0, 0, 5), 1), ("plate", (0.9, 0, 5), 1), ("fork", (0, -1, 5), 1)
    view, instances = view_of(*placed, ("spoon", (3, 0, 5), 1))
    facts = FactBase(relation_facts(view, instances))
    world = WorldMeasurement(SimpleNamespace(snapshot=view.snapshot))
    depth, _ = world.collision(Collision(entity="thing 0", other="thing 1", hard=True))
    assert facts.pair(0, 1).pairs.depth_m[0] == pytest.approx(depth) == pytest.approx(0.1)
    assert facts.margin("colliding", 1, 0) == pytest.approx(0.095)
    assert facts.margin("colliding", 0, 2) == -0.005, "it rests there"
    assert facts.margin("colliding", 0, 3) == pytest.approx(-2.005)


@pytest.mark.parametrize(("degrees", "margin"), [(0, -45), (180, -45), (90, 45), (-90, -135)])
def test_a_front_is_the_object_s_own_minus_y(degrees, margin):
    facts = base(("cup", (0, 0, 5), 0.4, degrees), ("plate", (2, 0, 5), 0.4))
    assert facts.margin("facing", 0, 1) == pytest.approx(margin)
    assert facts.margin("facing_away", 0, 1) == pytest.approx(-90 - margin)


def test_support_containment_and_fronts_are_the_plugin_s():
    placed = [("cup", (0.1, 0, 5), 1), ("plate", (0, -1.004, 5), 1), ("fork", (0.2, 0.2, 4.6), 0.5)]
    view, instances = view_of(*placed)
    facts = FactBase(relation_facts(view, instances))
    world = WorldMeasurement(SimpleNamespace(snapshot=view.snapshot))
    gap, _ = world.support(Support(entity="thing 1", on="thing 0", hard=True))
    assert facts.facts.pairs.gap_ba_m[0] == pytest.approx(gap, abs=1e-6) == pytest.approx(0.004)
    share, _ = world.containment(Containment(entity="thing 2", inside="thing 0", hard=True))
    assert facts.facts.pairs.inside_ba[1] == share
    angle, _ = world.facing(Facing(entity="thing 2", towards="thing 0", hard=True))
    assert facts.facts.pairs.angle_ba_deg[1] == pytest.approx(angle, abs=1e-6)


def test_the_largest_objects_are_kept_and_the_others_counted():
    placed = [("cup", (x, 0, 8), 0.1 + 0.1 * (x == 1)) for x in np.linspace(-2, 2, 9)]
    view, instances = view_of(*placed)
    facts = relation_facts(view, instances, most=3)
    assert (len(facts.objects), len(facts.pairs.a), facts.left_out) == (3, 3, 6)
    assert 6 in {thing.id for thing in facts.objects}


def test_thousands_of_objects_are_bounded_to_the_largest_hundred():
    random = np.random.default_rng(0)
    xyz = random.uniform((-4, -3, 5), (4, 3, 60), (2_000, 3))
    view, instances = view_of(*(("cup", tuple(place), 0.15) for place in xyz), size=(640, 480))
    facts = relation_facts(view, instances)
    visible = int((view.area_px > 0).sum())
    assert (len(facts.objects), len(facts.pairs.a)) == (100, 4950)
    assert facts.left_out == visible - 100 > 500
    smallest = min(thing.area_px for thing in facts.objects)
    assert smallest >= np.sort(view.area_px)[-100]


def test_superlatives_and_numbers_of_things():
    facts = base(*(("cup", (x, 0, 6 + x), 0.5) for x in (-2, 0, 2)), ("plate", (0, 1, 6), 0.5))
    for which, number in (("leftmost", 0), ("rightmost", 2), ("closest", 0), ("farthest", 2)):
        (found,) = facts.designated_objects(Designator(category="cup", which=which), clearly=True)
        assert found.id == number
    assert len(facts.designated_objects(Designator(category="cup"))) == 3
    assert facts.designated_objects(Designator(category="plate", which="leftmost"))[0].id == 3
    assert facts.designated_objects(Designator(category="fork")) == []


def test_without_fcl_the_run_stops_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "fcl", None)
    with pytest.raises(InstallationError, match=r"pip install .*python-fcl"):
        base(("cup", (0, 0, 5), 1))


def test_the_file_holds_the_facts_and_names_what_is_left_out(tmp_path, monkeypatch):
    view, instances = view_of(("cup", (0, 0, 5), 1), ("plate", (2, 0, 5), 1), (None, (0, 2, 5), 1))
    image = AnsweredImage(image_id=1, name="a/b", run=tmp_path, instances=instances, view=view)
    row = READOUT.write(RunRow(image_id=1, file_name="b.jpg", status="ok"), image)
    data = (tmp_path / row.answer.file).read_bytes()
    assert row.answer.bytes == len(data)
    assert decode(AnswerFile, data).facts == relation_facts(view, instances)
    assert [o["category"] for o in json.loads(data)["facts"]["objects"]] == ["cup", "plate"]
    told = [tuple(map(str, cells)) for cells in READOUT.table("relations", image).rows]
    assert ("0 cup", "left_of", "1 plate", "1.00", "m") in told


def test_a_row_says_how_many_objects_are_left_out(tmp_path):
    placed = [("cup", (x / 3, y / 3, 9), 0.2) for x in range(-7, 8) for y in range(-4, 4)]
    view, instances = view_of(*placed)
    image = AnsweredImage(image_id=1, name="a", run=tmp_path, instances=instances, view=view)
    row = READOUT.write(RunRow(image_id=1, file_name="a.jpg", status="ok"), image)
    assert row.answer.bytes < 1_200_000
    assert row.warnings == (
        "relations are of the 100 largest visible objects: 20 more are left out",
    )
