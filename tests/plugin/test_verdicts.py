"""Each kind of requirement on one room: a case that passes, one that fails, one unknown."""

from __future__ import annotations

import dataclasses
from typing import get_args

import numpy as np
import pytest
from plugin.live_room import shift
from plugin.synthetic import evidence_with, region_of

from legoworld.plugin.entities import Entities
from legoworld.plugin.measure import measure, surface_view
from legoworld.plugin.result_pictures import result_pictures
from legoworld.records import plugin_requirements as kinds
from legoworld.records.base import as_json, to_record

pytestmark = pytest.mark.blender

SIZE = (160, 120)
MATCHED = [["Table", "Table"], ["Chair", "Chair"], ["Floor", "Floor"]]
TURNED = [["Table", "Chair"], ["Chair", "Table"]]
NOBODY = {"entity": "Nobody"}

#: By kind: fields that pass, that fail, and that cannot be measured, on the room as it is.
CASES = {
    "existence": ({"entity": "Cup"}, NOBODY, None),  # absence is a failure, never unknown
    "valid_transform": ({"entity": "Cup"}, {"entity": "Cup", "ratio": 0.5}, NOBODY),
    "dimensions": (
        {"entity": "Cup", "low_m": [0.1, 0.1, 0.1], "high_m": [0.3, 0.3, 0.3]},
        {"entity": "Cup", "low_m": [0.1, 0.1, 0.3], "high_m": [0.3, 0.3, 0.4]},
        {"entity": "Lamp", "low_m": [0, 0, 0], "high_m": [1, 1, 1]},
    ),
    "support": ({"entity": "Cup", "on": "Table"}, {"entity": "Cup", "on": "Floor"}, NOBODY),
    "stability": ({"entity": "Cup"}, {"entity": "Cup", "margin_m": 0.2}, NOBODY),
    "hidden": ({"entity": "Cup"}, {"entity": "Table", "tolerance": 0.0}, NOBODY),
    "touching": (
        {"entity": "Cup", "on": "Table"},
        {"entity": "Cup", "on": "Floor"},
        {"entity": "Cup", "on": "Nobody"},
    ),
    "containment": (
        {"entity": "Cup", "inside": "Cup"},
        {"entity": "Cup", "inside": "Chair"},
        {"entity": "Cup", "inside": "Nobody"},
    ),
    "collision": (
        {"entity": "Cup", "other": "Chair"},
        {"entity": "Cup", "other": "Table", "sunk": True},
        {"entity": "Crate", "other": "Lid"},
    ),
    "facing": (
        {"entity": "Table", "towards": "Chair"},
        {"entity": "Chair", "towards": "Table"},
        {"entity": "Table", "towards": "Cup"},
    ),
    "layout": (
        {"entities": ["Chair", "Table", "Cup"], "tolerance": 5},
        {"entities": ["Chair", "Cup", "Crate"]},
        {"entities": ["Chair", "Nobody", "Crate"]},
    ),
    "visibility": ({"entity": "Cup"}, {"entity": "Cup", "area_px": 19_000}, {"entity": "Lamp"}),
    "centroid": (
        {"entity": "Cup", "region": "Cup"},
        {"entity": "Cup", "region": "Chair"},
        {"entity": "Cup", "region": "Plate"},
    ),
    "extent": (
        {"entity": "Cup", "region": "Cup"},
        {"entity": "Cup", "region": "Table"},
        {"entity": "Cup", "region": "dot"},
    ),
    "overlap": (
        {"entity": "Cup", "region": "Cup"},
        {"entity": "Cup", "region": "Chair"},
        {"entity": "Nobody", "region": "Cup"},
    ),
    "boundary": (
        {"entity": "Cup", "region": "Cup"},
        {"entity": "Floor", "region": "Cup"},
        {"entity": "Cup", "region": "dot"},
    ),
    "depth": (
        {"entity": "Table", "matched": MATCHED},
        {"entity": "Table", "matched": MATCHED, "tolerance": 1e-12},
        {"entity": "Table", "matched": MATCHED[:2]},
    ),
    "depth_order": (
        {"matched": MATCHED[:2]},
        {"matched": [["Chair", "Chair"], ["Crate", "Crate"]]},
        {"matched": TURNED},
    ),
    "colour": (
        {"entity": "Cup", "region": "Cup"},
        {"entity": "Cup", "region": "Table"},
        {"entity": "Cup", "region": "dot"},
    ),
    "luminance": ({"region": "Cup"}, {"region": "Table"}, {"region": "dot"}),
}  # fmt: skip


@pytest.fixture(scope="module")
def seen(live):
    """The room with evidence of its own masks: the table brighter in the photo, depth nearly so."""
    scene = live("none")
    buffers = surface_view(scene, SIZE)
    entities = Entities(scene.snapshot)
    names = ("Cup", "Table", "Chair", "Floor", "Crate")
    masks = {}
    for name in names:
        surfaces = entities.surfaces(name)
        assert surfaces is not None
        masks[name] = np.append(surfaces, False)[buffers.instance]
    dot = np.zeros(masks["Cup"].shape, bool)
    dot[0, :3] = True
    disparity = 1 / buffers.depth_z_m.astype(float)
    # The photo's depth has the table a little nearer than it is, and the crate in front of all.
    said = disparity * np.where(masks["Table"], 1.02, 1) * np.where(masks["Crate"], 100, 1)
    masks["dot"] = dot
    photo = np.full((*dot.shape, 3), 100, np.uint8)
    photo[masks["Table"]] = 200
    regions = [region_of(name, mask) for name, mask in masks.items()]
    evidence = evidence_with(regions, disparity=said, photo=photo, size=SIZE)
    return dataclasses.replace(scene, render=np.full((60, 80, 3), 100, np.uint8)), evidence


def result(seen, kind, fields):
    scene, evidence = seen
    if fields.pop("sunk", False):
        scene = shift(scene, "Cup", (0, 0, -0.02))
    requirements = to_record(tuple[kinds.Requirement, ...], [{"kind": kind, **fields}])
    report = measure(scene, requirements, evidence, size_wh=SIZE)
    return report.results[0], report


def test_every_kind_has_its_cases():
    assert set(CASES) == {k.__struct_config__.tag for k in get_args(kinds.Requirement)}


#: What has to pass unless it says otherwise; how the picture fits is relative.
OF_WORLD = {"existence", "valid_transform", "dimensions", "support", "stability", "touching",
            "containment", "collision", "facing", "layout", "visibility", "hidden"}  # fmt: skip


@pytest.mark.parametrize("kind", CASES)
@pytest.mark.parametrize("verdict", ["pass", "fail", "unknown"])
def test_every_kind_passes_fails_and_is_unknown(seen, kind, verdict):
    fields = dict(zip(("pass", "fail", "unknown"), CASES[kind], strict=True))[verdict]
    if fields is None:
        assert kind == "existence"
        return
    found, report = result(seen, kind, dict(fields))
    assert found.verdict == verdict, found
    assert report.blocked is (verdict == "unknown" or (verdict == "fail" and kind in OF_WORLD))
    _, asked = result(seen, kind, {**fields, "accept": "passes"})
    assert asked.blocked is (verdict != "pass")
    if verdict == "unknown":
        assert found.residual is None
        assert found.reason
    elif found.residual is not None:
        assert (found.residual <= found.tolerance) is (verdict == "pass")


@pytest.mark.parametrize("kind", CASES)
def test_every_kind_has_a_small_picture(seen, kind):
    scene, evidence = seen
    fields = CASES[kind][0]
    _, report = result(seen, kind, fields)
    (picture,) = result_pictures(scene, evidence, report)
    assert picture is not None
    assert picture.dtype == np.uint8
    assert max(picture.shape[:2]) <= 240
    blue = (picture[..., 2].astype(int) - picture[..., 0]) > 60
    orange = (picture[..., 0].astype(int) - picture[..., 2]) > 60
    requirement = as_json(report.results[0].requirement)
    assert blue.any() or "region" in requirement
    assert orange.any() is np.bool_("region" in requirement or "matched" in requirement)


def test_there_is_no_picture_of_what_is_not_there(seen):
    scene, evidence = seen
    _, report = result(seen, "existence", NOBODY)
    assert result_pictures(scene, evidence, report) == [None]
