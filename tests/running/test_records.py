"""Records that come from other machines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from legoworld.readouts.family import protocol
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.records.run_rows import DepthFile, RunRow
from legoworld.running.image import check_arrived
from legoworld.running.image_record import ImageOptions


def options_of(folder: Path, max_side: int | None = None) -> ImageOptions:
    return ImageOptions(
        scenes=folder, run=folder / "here", protocol=protocol("eth3d", None), source="blend",
        cache=None, require_frozen=False, max_side=max_side, threads=1,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("size", "side", "expected"),
    [
        ((6048, 4032), 1024, (1024, 683)),
        ((4032, 6048), 1024, (683, 1024)),
        ((640, 480), 1024, (640, 480)),
        ((640, 480), None, (640, 480)),
        ((5000, 1), 10, (10, 1)),
        ((1, 5000), 10, (1, 10)),
        ((1001, 1000), 1000, (1000, 999)),
        ((1000, 700), 1000, (1000, 700)),
    ],
)
def test_a_smaller_picture_keeps_its_aspect(size, side, expected):
    assert options_of(Path(), side).rendered_size(size) == expected


def test_a_depth_file_that_is_not_seen_here_is_a_verdict(tmp_path: Path):
    options = options_of(tmp_path)
    there = replace(options, run=tmp_path / "there")
    file = there.run / "depth" / "a.npz"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"depth")
    row = RunRow(
        image_id=1, file_name="a.JPG", scene="a", size_wh=(4, 3), status="ok",
        depth=DepthFile(file="depth/a.npz"),
    )  # fmt: skip
    record = ImageRecord(row=row, scene=ImageSource(scene="a"))
    assert check_arrived(record, there) is record
    lost = check_arrived(record, options)
    assert (lost.row.status, lost.row.code) == ("failed", "run_folder_not_shared")
    assert (lost.row.image_id, lost.row.scene, lost.row.size_wh) == (1, "a", (4, 3))
    assert not lost.row.depth
    assert "--shard" in lost.row.reason
    assert lost.scene is None
