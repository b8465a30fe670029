"""Exact IoU of boxes in space: known values, SciPy's, and what must not change it."""

import numpy as np
import pytest
from evaluation.solids import about_y, box, rotation, scipy_iou
from hypothesis import given, settings
from hypothesis import strategies as st

from legoworld.evaluation.box_overlaps import box_ious, box_volumes

CUBE = box()
SEEDS = st.integers(0, 2**32 - 1)


def some_box(random, mirrored=False):
    size = random.uniform(0.2, 1.5, 3)
    return box(random.normal(size=3) * 0.4, size, rotation(random, mirrored))


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (CUBE, box((0.5, 0, 0)), 1 / 3),
        (CUBE, box(rotation=about_y(45)), 2**-0.5),
        (box(size=(2, 1, 0.1)), box((0, 0, 0.05), (2, 1, 0.1)), 1 / 3),
        (CUBE, CUBE, 1.0),
        (CUBE, box(size=(0.5, 0.5, 0.5)), 1 / 8),
    ],
)
def test_known_overlaps(one, other, expected):
    assert box_ious([one], [other])[0, 0] == pytest.approx(expected, abs=1e-15)


def test_a_touch_and_a_flat_box_overlap_nothing():
    others = [box((1, 1, 1)), box((1, 0, 0)), box((0, 0, 1.0)), box(size=(1, 1, 0)), box((9, 9, 9))]
    assert box_ious([CUBE], others).tolist() == [[0.0] * 5]
    turned = rotation(np.random.default_rng(3))
    flat = box((1e3, 0, 50), (2, 1, 0), turned)
    assert box_volumes([flat, CUBE]).tolist() == [0.0, 1.0]
    assert box_ious([flat], [flat]).tolist() == [[0.0]]


def test_nothing_on_one_side():
    assert box_ious(np.empty((0, 8, 3)), [CUBE]).shape == (0, 1)
    assert box_ious([CUBE], np.empty((0, 8, 3))).shape == (1, 0)


@settings(max_examples=20)
@given(SEEDS, st.booleans(), st.booleans())
def test_as_scipy_measures_it(seed, mirrored, other_mirrored):
    random = np.random.default_rng(seed)
    one, other = some_box(random, mirrored), some_box(random, other_mirrored)
    assert box_ious([one], [other])[0, 0] == pytest.approx(scipy_iou(one, other), abs=1e-9)


@settings(max_examples=20)
@given(SEEDS)
def test_a_motion_of_both_a_swap_and_a_scale_change_nothing(seed):
    random = np.random.default_rng(seed)
    one, other = some_box(random), some_box(random)
    iou = box_ious([one], [other])[0, 0]
    turn, away = rotation(random), random.normal(size=3) * 20
    moved = box_ious([one @ turn.T + away], [other @ turn.T + away])[0, 0]
    assert moved == pytest.approx(iou, abs=1e-11)
    assert box_ious([other], [one])[0, 0] == pytest.approx(iou, abs=1e-12)
    assert box_ious([one * 1e-3], [other * 1e-3])[0, 0] == pytest.approx(iou, abs=1e-12)
    assert 0 <= iou <= 1


@settings(max_examples=20)
@given(SEEDS, st.floats(1e-17, 1e-6))
def test_noise_in_the_corners_moves_little(seed, noise):
    """Faces of two equal boxes coincide up to rounding: no face is lost or counted twice."""
    random = np.random.default_rng(seed)
    one = some_box(random) + 10
    iou = box_ious([one], [one + random.normal(size=(8, 3)) * noise])[0, 0]
    assert 1 - iou < 200 * (noise + 1e-15)


def test_a_sheared_box_is_a_solid_like_any_other():
    shear = np.array([[1, 0.7, 0], [0, 1, 0], [0, 0, 1]])
    one, other = CUBE @ shear.T, box((0.2, 0.1, 0))
    assert box_volumes([one])[0] == pytest.approx(1)
    assert box_ious([one], [other])[0, 0] == pytest.approx(scipy_iou(one, other), abs=1e-9)
