"""A submitted camera against the reference's."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from legoworld.evaluation.reconstruction.case import camera_error


def placed(rotation, at):
    return np.hstack([rotation.as_matrix(), np.array(at, float)[:, None]]).tolist()


@pytest.mark.parametrize("degrees", [0.0, 1.0, 30.0, 90.0, 180.0])
def test_the_angle_is_of_the_rotation_between_both(degrees):
    theirs = Rotation.from_euler("xyz", [20, -70, 100], degrees=True)
    axis = np.array([1.0, 2.0, -2.0]) / 3
    ours = Rotation.from_rotvec(np.radians(degrees) * axis) * theirs
    camera = SimpleNamespace(world_from_cam=placed(ours, (1, 2, 6)), hfov_deg=62.0)
    truth = SimpleNamespace(camera=SimpleNamespace(world_from_cam=placed(theirs, (1, 5, 2))))
    case = SimpleNamespace(truth=truth, image=SimpleNamespace(hfov_deg=60.0))
    found = camera_error(SimpleNamespace(camera=camera), case, None)
    assert found.world_rotation_deg == pytest.approx(degrees, abs=1e-5)
    assert found.world_translation_m == pytest.approx(5.0)
    assert found.fov_deg == pytest.approx(2.0)
