"""The comparison itself: it must see what is wrong, and only that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from agreement.comparison import ObjectPicture, compare, compare_normals, silhouette


def two_halves(size: int = 100) -> ObjectPicture:
    """A near object on the left, a far one on the right, nothing in the top quarter."""
    instance = np.zeros((size, size), np.int32)
    instance[:, size // 2 :] = 1
    instance[: size // 4] = -1
    depth = np.where(instance == 0, 2.0, np.where(instance == 1, 5.0, np.inf)).astype(np.float32)
    return ObjectPicture(instance=instance, names=("a|", "b|"), depth_z_m=depth)


def rename_objects(picture: ObjectPicture) -> ObjectPicture:
    """The same picture, its ids and names in another order and one instance in two."""
    instance = np.select([picture.instance == 0, picture.instance == 1], [2, 0], -1).astype(
        np.int32
    )
    instance[-10:][instance[-10:] == 2] = 1
    return replace(picture, instance=instance, names=("b|", "a|", "a|"))


def test_a_picture_agrees_with_itself_under_other_ids() -> None:
    found = compare(rename_objects(two_halves()), two_halves())
    assert (found.same, found.same_inside, found.depth, found.depth_worst) == (1, 1, 1, 0)
    assert found.hit == 0.75
    assert found.verdict == "ok"


def test_instances_of_one_object_are_not_told_apart_by_name() -> None:
    assert rename_objects(two_halves()).areas() == {"a|": 3750, "b|": 3750}


@pytest.mark.parametrize(("axis", "missed"), [(0, "same"), (1, "same")])
def test_a_picture_moved_by_three_pixels_is_seen(axis: int, missed: str) -> None:
    right = two_halves()
    moved = replace(
        right,
        instance=np.roll(right.instance, 3, axis),
        depth_z_m=np.roll(right.depth_z_m, 3, axis),
    )
    found = compare(moved, right)
    assert found.verdict.startswith(f"below: {missed}")
    assert 0.93 < found.same < 0.99


def test_a_swap_of_two_objects_is_named() -> None:
    right = two_halves()
    found = compare(replace(right, names=("b|", "a|")), right)
    assert found.same == 0.25
    assert {row[:2] for row in found.differing} == {("a|", "b|"), ("b|", "a|")}
    assert np.isnan(found.depth)
    assert "depth" in found.verdict


def test_depth_is_judged_where_the_object_is_shared() -> None:
    right = two_halves()
    depth = right.depth_z_m.copy()
    depth[60, 10:30] *= 1.001
    found = compare(replace(right, depth_z_m=depth), right)
    assert found.shared * (1 - found.depth) == pytest.approx(20)
    assert found.depth_worst == pytest.approx(1e-3, rel=1e-3)
    assert found.verdict == "below: depth"


def test_two_objects_at_one_depth_are_a_tie() -> None:
    right = two_halves()
    instance = right.instance.copy()
    instance[50, 70:90] = 0
    found = compare(replace(right, instance=instance), right)
    assert (found.tied, round((1 - found.same) * 10_000)) == (20, 20)
    depth = right.depth_z_m.copy()
    depth[50, 70:80] *= 1.01
    assert compare(replace(right, instance=instance, depth_z_m=depth), right).tied == 10


def test_what_is_left_out_is_not_judged() -> None:
    right = two_halves()
    wrong = replace(
        right, instance=np.where(right.instance == 1, -1, right.instance).astype(np.int32)
    )
    assert compare(wrong, right).verdict == "below: same, same_inside"
    found = compare(wrong, right, left_out=("b|",))
    assert found.verdict == "ok"
    assert found.pixels == 6250


def test_a_silhouette_is_one_pixel_on_each_side() -> None:
    ids = np.zeros((7, 9), np.int32)
    ids[3, 4] = 5
    expected = np.zeros((7, 9), bool)
    expected[2:5, 3:6] = True
    assert (silhouette(ids) == expected).all()
    assert not silhouette(np.full((4, 4), -1, np.int32)).any()


def test_pictures_of_two_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="against"):
        compare(two_halves(100), two_halves(96))


def tilt_picture(degrees: float, bend: float = 0.0) -> ObjectPicture:
    """Two halves whose normals are so far from the camera's axis; the right half is bent."""
    picture = two_halves()
    angles = np.radians(np.where(picture.instance == 1, degrees + bend, degrees))
    normal = np.stack([np.sin(angles), 0 * angles, -np.cos(angles)], axis=-1).astype(np.float32)
    return replace(picture, normal_world=normal)


def test_normals_are_judged_off_silhouettes_and_creases() -> None:
    assert compare_normals(tilt_picture(3.0), tilt_picture(3.05)).within == 1.0
    found = compare_normals(tilt_picture(3.0, bend=0.2), tilt_picture(3.0))
    assert found.within == pytest.approx(0.5, abs=0.01)
    assert found.worst_deg == pytest.approx(0.2, abs=1e-4)
    crease = compare_normals(tilt_picture(0.0, bend=40), tilt_picture(0.0, bend=40))
    assert (crease.within, crease.creased) == (1.0, 0), "it is where the silhouette is"
    opposite = tilt_picture(3.0)
    assert opposite.normal_world is not None
    turned = replace(opposite, normal_world=-opposite.normal_world)
    assert compare_normals(turned, tilt_picture(3.0)).within == 0.0
    nothing = replace(opposite, normal_world=np.zeros_like(opposite.normal_world))
    assert np.isnan(compare_normals(nothing, tilt_picture(3.0)).within)
