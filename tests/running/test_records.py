"""Records that come from other machines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from legoworld.readouts.tasks import protocol
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.records.run_rows import DepthFile, RunRow
from legoworld.running.image import arrived
from legoworld.running.image_record import ImageOptions


def test_a_depth_file_that_is_not_seen_here_is_a_verdict(tmp_path: Path):
    options = ImageOptions(
        scenes=tmp_path, run=tmp_path / "here", protocol=protocol("eth3d", None), source="blend",
        cache=None, require_frozen=False, max_side=None, threads=1,
    )  # fmt: skip
    there = replace(options, run=tmp_path / "there")
    file = there.run / "depth" / "a.npz"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"depth")
    row = RunRow(
        image_id=1, file_name="a.JPG", scene="a", size_wh=(4, 3), status="ok",
        depth=DepthFile(file="depth/a.npz"),
    )  # fmt: skip
    record = ImageRecord(row=row, scene=ImageSource(scene="a"))
    assert arrived(record, there) is record
    lost = arrived(record, options)
    assert (lost.row.status, lost.row.code) == ("failed", "run_folder_not_shared")
    assert (lost.row.image_id, lost.row.scene, lost.row.size_wh) == (1, "a", (4, 3))
    assert not lost.row.depth
    assert "--shard" in lost.row.reason
    assert lost.scene is None
