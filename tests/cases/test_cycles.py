"""Row 43: the built scenes as Cycles' own data passes show them."""

from __future__ import annotations

from pathlib import Path

import pytest
from agreement.comparison import compare
from agreement.judge import Judge
from agreement.ours import picture_of, snapshot_of

from legoworld.scene.folder import SceneFolder

pytestmark = pytest.mark.blender

#: Scenes of rows 15 to 31 whose surfaces are not all cut exactly at pixel edges or at clip planes.
SCENES = ("inside_a_sphere", "five_parts", "particles", "kinds", "shifted_and_stretched", "scales")


def test_row_43_one_sample_of_cycles_sees_the_same_objects_as_far_away(cases, tmp_path: Path):
    with (tmp_path / "judge.log").open("wb") as log, Judge(log) as judge:
        for name in SCENES:
            folder = cases.folder / name
            snapshot = snapshot_of(SceneFolder(path=folder, name=name), cases.blender)
            size = (160, 120)
            ours = picture_of(snapshot, size)
            cycles = judge.picture_of(folder / "scene.blend", size, tmp_path / f"{name}.npz")
            found = compare(ours, cycles)
            assert found.shared > 100, name
            assert found.same_inside > 0.99, (name, found)
            assert found.depth > 0.99, (name, found)
