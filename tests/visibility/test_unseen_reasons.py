"""Why instances are not seen: the same, whichever of them are asked about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scene.by_hand import HandScene

from legoworld.scene.instances import group
from legoworld.scene.labels import Labels
from legoworld.visibility import view as view_module
from legoworld.visibility.view import unseen_reasons, view


@pytest.fixture
def scene():
    """Triangles before and beside an orthographic-like view, one hidden behind another."""
    hand = HandScene()
    names = ("Near", "Hidden", "Beside", "Behind", "Tiny")
    for name in names:
        hand.object(name)
        hand.occurs(name)
    snapshot = hand.snapshot()
    big = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], np.float32)
    places = {"Near": (0, 0, 4), "Hidden": (0, 0, 8), "Beside": (90, 0, 5), "Behind": (0, 0, -5),
              "Tiny": (0.001, 0.001, 3)}  # fmt: skip
    order = [snapshot.objects[i].name for i in snapshot.occurrence_object[
        snapshot.surface_occurrence]]  # fmt: skip
    eye = np.array(snapshot.camera.world_from_camera)
    matrices = np.zeros((len(order), 3, 4))
    for i, name in enumerate(order):
        local = np.eye(4)
        local[:3, :3] *= 1e-6 if name == "Tiny" else 0.5 if name == "Hidden" else 1.0
        local[:3, 3] = places[name]
        matrices[i] = eye @ local
    count = len(order)
    return replace(
        snapshot,
        vertices=np.tile(big, (count, 1)),
        triangles=np.tile(np.array([[0, 1, 2]], np.int32), (count, 1)),
        vertex_start=np.arange(count + 1, dtype=np.int64) * 3,
        triangle_start=np.arange(count + 1, dtype=np.int64),
        surface_mesh=np.arange(count, dtype=np.int32),
        world_from_mesh=matrices,
    )


def test_a_subset_gets_the_reasons_that_all_get(scene, monkeypatch):
    grouping = group(scene, Labels(objects={}, collections={}, warnings=()))
    seen = view(scene, grouping, (64, 48))
    reasons = unseen_reasons(scene, grouping, seen)
    by_name = {grouping.instances[i].name: reason for i, reason in reasons.items()}
    assert by_name == {
        "Hidden": "hidden",
        "Beside": "outside_view",
        "Behind": "behind_camera",
        "Tiny": "sub_pixel",
    }
    asked: list[int] = []
    coverage = view_module.coverage
    monkeypatch.setattr(
        view_module,
        "coverage",
        lambda s, *args, **more: asked.append(len(s.triangles)) or coverage(s, *args, **more),
    )
    for number, reason in reasons.items():
        assert unseen_reasons(scene, grouping, seen, among=[number]) == {number: reason}
    assert asked == [1, 1, 1, 1]
    (near,) = {i.id for i in grouping.instances} - set(reasons)
    assert unseen_reasons(scene, grouping, seen, among=[near]) == {}
    assert len(asked) == 4


def test_an_instance_has_the_nearest_of_its_surfaces_reasons(scene):
    """Hidden comes before outside of the view: it takes less to show."""
    grouping = group(scene, Labels(objects={}, collections={}, warnings=()))
    names = [instance.name for instance in grouping.instances]
    for first, second, expected in [
        ("Beside", "Hidden", "hidden"), ("Hidden", "Beside", "hidden"),
        ("Behind", "Tiny", "sub_pixel"), ("Behind", "Beside", "outside_view"),
    ]:  # fmt: skip
        owner = grouping.surface_instance.copy()
        owner[owner == names.index(second)] = names.index(first)
        both = replace(grouping, surface_instance=owner)
        reasons = unseen_reasons(scene, both, view(scene, both, (64, 48)))
        assert reasons[names.index(first)] == expected


def test_held_out_is_what_has_no_other_surface(scene):
    grouping = group(scene, Labels(objects={}, collections={}, warnings=()))
    names = [instance.name for instance in grouping.instances]
    behind, beside = names.index("Behind"), names.index("Beside")
    held = (grouping.surface_instance == behind).astype(np.uint8)
    alone = replace(scene, surface_holdout=held)
    reasons = unseen_reasons(alone, grouping, view(alone, grouping, (64, 48)))
    assert (reasons[behind], reasons[beside]) == ("holdout", "outside_view")
    owner = grouping.surface_instance.copy()
    owner[owner == beside] = behind
    mixed = replace(grouping, surface_instance=owner)
    assert unseen_reasons(alone, mixed, view(alone, mixed, (64, 48)))[behind] != "holdout"
