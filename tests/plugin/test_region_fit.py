"""How well a scene fits the photo's regions: matched by pixels, never by names."""

from __future__ import annotations

import numpy as np
import pytest
from plugin.synthetic import evidence_with, region_of

from legoworld.plugin.entities import Entities
from legoworld.plugin.measure import surface_pixels, surface_view
from legoworld.plugin.region_fit import region_fit

pytestmark = pytest.mark.blender

WH = (160, 120)


def mask_of(scene, name):
    surfaces = Entities(scene.snapshot).surfaces(name)
    return surface_pixels(surfaces, surface_view(scene, WH))


def evidence_of(scene, names):
    """The scene's own objects as regions of other names."""
    regions = [region_of(f"region {n}", mask_of(scene, name)) for n, name in enumerate(names)]
    return evidence_with(regions, size=WH)


def test_a_scene_fits_its_own_regions_whatever_they_are_called(live):
    scene = live("none")
    fit = region_fit(scene, evidence_of(scene, ["Table", "Cup", "Chair"]))
    assert fit == {"region 0": 1.0, "region 1": 1.0, "region 2": 1.0}


def test_the_parts_of_an_object_count_for_it(live):
    scene = live("none")
    assert (mask_of(scene, "Crate") & mask_of(scene, "Lid")).any()
    assert region_fit(scene, evidence_of(scene, ["Crate"])) == {"region 0": 1.0}


def test_an_object_off_its_place_fits_less_and_one_that_is_gone_not_at_all(live):
    evidence = evidence_of(live("none"), ["Table", "Cup", "Chair"])
    moved, gone = region_fit(live("moved"), evidence), region_fit(live("deleted"), evidence)
    assert moved["region 1"] < 0.5
    assert moved["region 2"] == gone["region 1"] == 1.0
    assert gone["region 2"] < 0.1
    same = region_fit(live("renamed"), evidence)
    assert same == region_fit(live("none"), evidence)


def test_an_object_is_matched_to_one_region_alone(live):
    scene = live("none")
    table = mask_of(scene, "Table")
    half = table & (np.arange(WH[0]) < WH[0] // 2)
    regions = [region_of("all", table), region_of("half", half)]
    fit = region_fit(scene, evidence_with(regions, size=WH))
    assert fit["all"] == 1.0
    assert fit["half"] < 0.2
    assert region_fit(scene, evidence_with([], size=WH)) == {}
