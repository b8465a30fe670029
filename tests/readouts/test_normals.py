"""The readout of normals: its file and row, and that no grouping changes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from readouts.quads import SQUARE, at, quads, rotation

from legoworld.evaluation.normals.arrays import read_prediction
from legoworld.readouts.family import AnsweredImage
from legoworld.readouts.normals import NORMALS_FILE, READOUT
from legoworld.records.run_rows import RunRow
from legoworld.scene.instances import group
from legoworld.scene.labels import Labels
from legoworld.visibility.normals import render_normals
from legoworld.visibility.view import view

SIZE = (64, 48)
UNLABELLED = Labels(objects={}, collections={}, warnings=())


def draw_view(snapshot):
    return view(snapshot, group(snapshot, UNLABELLED), SIZE)


def write_view(snapshot, folder):
    row = RunRow(image_id=1, file_name="a.jpg", status="ok")
    image = AnsweredImage(image_id=1, name="a", run=folder, instances=(), view=draw_view(snapshot))
    (folder / "normals").mkdir()
    return READOUT.write(row, image)


def test_a_wall_that_is_turned_and_the_wall_behind_it(tmp_path):
    tilted = at(0, 0, 0, rotation(30) @ np.diag([1.0, 2.0, 5.0]))
    backwards = at(0, 0, -5, np.diag([-9.0, 9.0, -1.0]))
    snapshot = quads(("near", SQUARE, tilted), ("far", SQUARE, backwards))
    row = write_view(snapshot, tmp_path)
    near = draw_view(snapshot).buffers.instance == 0
    with np.load(tmp_path / row.normals.file) as arrays:
        found = arrays["normal_cam"]
        assert {k: str(arrays[k]) for k in ("sign",)} == NORMALS_FILE.labels
        assert str(arrays["variant"]) == "geometric"
        assert (found.dtype, found.shape) == (np.float32, (48, 64, 3))
    # The camera looks along -z with y up: its own z is the world's -z, its x the world's x.
    assert found[near] == pytest.approx(
        np.tile([0.5, 0, -np.sqrt(0.75)], (near.sum(), 1)), abs=1e-6
    )
    assert np.all(found[~near] == np.array([0, 0, -1], np.float32))
    assert row.normals.finite_px == 48 * 64
    assert row.normals.flipped_share == (~near).sum() / near.size
    assert read_prediction(tmp_path / row.normals.file, None).sign == row.normals.sign
    assert row.normals.bytes <= READOUT.file_bytes(SIZE)
    assert row.files == [row.normals]


def test_a_picture_of_nothing_is_all_holes(tmp_path):
    row = write_view(quads(("behind", SQUARE, at(0, 0, 20))), tmp_path)
    assert (row.normals.finite_px, row.normals.flipped_share) == (0, None)
    with np.load(tmp_path / row.normals.file) as arrays:
        assert np.isnan(arrays["normal_cam"]).all()


def test_where_surfaces_tie_the_first_placement_is_taken_whatever_its_instance():
    """Two squares cross along a vertical line of pixel centres."""
    placed = (("left", 45), ("right", -45))
    snapshot = quads(*((name, SQUARE, at(0, 0, 0, rotation(angle))) for name, angle in placed))
    seen = view(snapshot, group(snapshot, UNLABELLED), (65, 49))
    swapped = replace(seen.surfaces, placement_id=1 - seen.surfaces.placement_id)
    by_instance = render_normals(swapped, seen.projection, seen.size_wh)
    found = [n.tobytes() for n in (seen.normals().normal_cam, by_instance.normal_cam)]
    assert found[0] != found[1]
    assert replace(seen, surfaces=swapped).normals().normal_cam.tobytes() == found[0]
