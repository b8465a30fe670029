"""Amodal layers: each instance as if it were alone, and who hides whom."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from visibility import oracle
from visibility.kernel_scenes import (
    ball_pit,
    jumble,
    only,
    pixel_camera,
    pixel_rectangle,
    place,
)

from legoworld.errors import LegoWorldError
from legoworld.visibility.kernel import HOLDOUT, LEVEL_VARIABLE, LEVELS, render
from legoworld.visibility.layers import (
    amodal_areas,
    amodal_layers,
    direct_occluders,
    most_entries,
    occluders,
    visible_areas,
)

SIZE = (100, 100)
CAMERA = pixel_camera(SIZE)


def plate(x, side, z):
    """A square that faces the camera, its centre at (x, 0, z) metres."""
    u, v, half = 50 + 100 * x / z, 50, 50 * side / z
    return pixel_rectangle(CAMERA, u - half, v - half, u + half, v + half, z)


def count_pairs(pairs):
    rows = zip(pairs.hidden.tolist(), pairs.hiding.tolist(), pairs.count.tolist(), strict=True)
    return {(hidden, hiding): count for hidden, hiding, count in rows}


def bytes_of(layers):
    return layers.start.tobytes(), layers.instance.tobytes(), layers.depth_z_m.tobytes()


def assert_first_entries_are_the_picture(layers, surfaces, camera, size_wh):
    seen = render(surfaces, camera, size_wh)
    ids = np.full(size_wh[0] * size_wh[1], -1, np.int32)
    depth = np.full(len(ids), np.inf, np.float32)
    covered = np.diff(layers.start) > 0
    first = layers.start[:-1][covered]
    ids[covered], depth[covered] = layers.instance[first], layers.depth_z_m[first]
    depth[ids == HOLDOUT] = np.inf
    ids[ids == HOLDOUT] = -1
    assert seen.instance.tobytes() == ids.tobytes()
    assert seen.depth_z_m.tobytes() == depth.tobytes()


def assert_alone(layers, surfaces, camera, size_wh, ident):
    alone = render(only(surfaces, ident), camera, size_wh)
    mask = layers.mask(ident)
    np.testing.assert_array_equal(mask, np.isfinite(alone.depth_z_m))
    own = layers.depth_z_m[layers.instance == ident]
    assert own.tobytes() == alone.depth_z_m[mask].tobytes()


@pytest.mark.parametrize("seed", range(12))
def test_every_instance_is_what_is_drawn_of_it_alone(seed):
    surfaces, camera, size_wh = jumble(seed)
    layers = amodal_layers(surfaces, camera, size_wh)
    assert_first_entries_are_the_picture(layers, surfaces, camera, size_wh)
    for ident in (HOLDOUT, 0, 2, 3, 5, 7, 9):
        assert_alone(layers, surfaces, camera, size_wh, ident)
    assert len(layers.instance) == layers.start[-1] > 0
    pixel = layers.pixels()
    in_order = np.lexsort((layers.instance, layers.depth_z_m, pixel))
    np.testing.assert_array_equal(in_order, np.arange(len(pixel)))


@pytest.mark.parametrize("seed", range(6))
def test_amodal_masks_are_the_oracles(seed):
    surfaces, camera, size_wh = jumble(seed)
    layers = amodal_layers(surfaces, camera, size_wh)
    agreed = 0
    for ident in (0, 2, 3, 5, 9):
        truth = oracle.render(only(surfaces, ident), camera, size_wh)
        sure = ~truth.doubtful
        mask = layers.mask(ident)
        np.testing.assert_array_equal(mask[sure], (truth.instance >= 0)[sure])
        agreed += int((mask & sure).sum())
        depth = np.full(mask.shape, np.inf)
        depth[mask] = layers.depth_z_m[layers.instance == ident]
        both = mask & (truth.instance >= 0)
        np.testing.assert_allclose(depth[both], truth.depth_z_m[both].astype(float), rtol=1.2e-7)
    assert agreed > 500


@pytest.mark.parametrize("seed", range(6))
def test_what_hides_an_instance_adds_up_to_its_hidden_pixels(seed):
    surfaces, camera, size_wh = jumble(seed)
    layers = amodal_layers(surfaces, camera, size_wh)
    area, visible = amodal_areas(layers, 10), visible_areas(layers, 10)
    seen = render(surfaces, camera, size_wh)
    shown = np.bincount(seen.instance[seen.instance >= 0], minlength=10)
    np.testing.assert_array_equal(visible, shown)
    for pairs in (occluders(layers), direct_occluders(layers)):
        hidden = np.bincount(pairs.hidden, weights=pairs.count, minlength=10)
        np.testing.assert_array_equal(hidden, area - visible)
    for (i, j), count in count_pairs(occluders(layers)).items():
        front = layers.mask(HOLDOUT) & (seen.instance == -1) if j == HOLDOUT else seen.instance == j
        assert count == (layers.mask(i) & front).sum()
    assert visible[7] == 0  # the same triangles as 0, which wins ties
    assert area[7] == area[0]
    assert count_pairs(direct_occluders(layers)).get((7, 0)) == area[7]


@pytest.mark.parametrize("seed", range(3))
def test_same_bytes_for_threads_and_instruction_sets(seed, monkeypatch):
    surfaces, camera, size_wh = jumble(seed)
    first = bytes_of(amodal_layers(surfaces, camera, size_wh, threads=1))
    for threads in (2, 4):
        assert bytes_of(amodal_layers(surfaces, camera, size_wh, threads=threads)) == first
    for level in LEVELS:
        monkeypatch.setenv(LEVEL_VARIABLE, level)
        assert bytes_of(amodal_layers(surfaces, camera, size_wh, threads=2)) == first


def test_instances_of_several_rounds():
    surfaces, size_wh = ball_pit(420), (200, 150)
    camera = pixel_camera(size_wh)
    layers = amodal_layers(surfaces, camera, size_wh, threads=2)
    assert bytes_of(layers) == bytes_of(amodal_layers(surfaces, camera, size_wh, threads=1))
    assert_first_entries_are_the_picture(layers, surfaces, camera, size_wh)
    assert np.diff(layers.start).max() > 24
    for ident in (0, 97, 98, 99, 209):
        assert_alone(layers, surfaces, camera, size_wh, ident)


def test_a_plate_in_front_of_the_middle_of_another():
    layers = amodal_layers(place([plate(0, 1, 2), plate(0, 0.5, 1)]), CAMERA, SIZE)
    assert amodal_areas(layers, 2).tolist() == [2500, 2500]
    assert visible_areas(layers, 2).tolist() == [0, 2500]
    assert count_pairs(occluders(layers)) == {(0, 1): 2500}


def test_a_plate_in_front_of_half_of_another():
    layers = amodal_layers(place([plate(0, 1, 2), plate(0.25, 0.5, 1)]), CAMERA, SIZE)
    assert amodal_areas(layers, 2).tolist() == [2500, 2500]
    assert visible_areas(layers, 2).tolist() == [1250, 2500]
    assert count_pairs(occluders(layers)) == {(0, 1): 1250}


def test_a_plate_half_outside_the_picture():
    layers = amodal_layers(place([plate(0, 1, 2), plate(0.5, 0.5, 1)]), CAMERA, SIZE)
    assert amodal_areas(layers, 2).tolist() == [2500, 1250]
    assert visible_areas(layers, 2).tolist() == [2500, 1250]
    assert count_pairs(occluders(layers)) == {}


def test_direct_occluders_are_the_next_layer():
    plates = [plate(0, 0.24 * z, z) for z in (4, 3, 2)]  # all 24 pixels wide
    layers = amodal_layers(place(plates), CAMERA, SIZE)
    assert count_pairs(occluders(layers)) == {(0, 2): 576, (1, 2): 576}
    assert count_pairs(direct_occluders(layers)) == {(0, 1): 576, (1, 2): 576}
    near = layers.nearest(2)
    assert near.start[-1] == 1152
    assert set(near.instance.tolist()) == {1, 2}
    assert near.mask(1).sum() == near.mask(2).sum() == 576


def test_pairs_of_ids_that_lie_far_apart():
    surfaces = place([plate(0, 0.24 * z, z) for z in (4, 3, 2)])
    for ids in ([0, 1, 2], [7, 2_000_000_000, HOLDOUT], [2**31 - 2, 0, 5]):
        named = dataclasses.replace(surfaces, placement_id=np.array(ids, np.int32))
        far, middle, near = ids
        expected = {(far, near): 576, (middle, near): 576}
        assert count_pairs(occluders(amodal_layers(named, CAMERA, SIZE))) == expected


def test_no_instances_and_instances_beside_the_picture():
    nothing = amodal_layers(place([], []), CAMERA, SIZE)
    assert (nothing.start == 0).all()
    assert len(nothing.instance) == len(nothing.depth_z_m) == 0
    beside = amodal_layers(place([plate(9, 1, 2)]), CAMERA, SIZE)
    assert bytes_of(beside) == bytes_of(nothing)
    assert amodal_areas(beside, 1).tolist() == visible_areas(beside, 1).tolist() == [0]
    assert count_pairs(occluders(beside)) == {}


@pytest.mark.parametrize("seed", range(6))
def test_the_bound_is_no_less_than_the_entries_and_no_more_than_all_pictures(seed):
    surfaces, camera, size_wh = jumble(seed)
    most = most_entries(surfaces, camera, size_wh)
    assert len(amodal_layers(surfaces, camera, size_wh).instance) <= most
    assert most <= len(surfaces.placement_mesh) * size_wh[0] * size_wh[1]


def test_the_bound_of_a_plate_is_its_own_pixels():
    assert 2500 <= most_entries(place([plate(0, 1, 2)]), CAMERA, SIZE) <= 52 * 52


def test_more_entries_than_allowed_are_refused():
    surfaces = place([plate(0, 1, 2), plate(0, 0.5, 1)])
    assert len(amodal_layers(surfaces, CAMERA, SIZE, max_entries=5000).instance) == 5000
    with pytest.raises(LegoWorldError, match="more than 4999 pixels"):
        amodal_layers(surfaces, CAMERA, SIZE, max_entries=4999)
