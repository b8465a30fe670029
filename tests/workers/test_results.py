"""What a program left in the place of its files is looked at before it is used."""

from __future__ import annotations

import pytest
from swapping import SWAPS, swapping

from legoworld.scene.programs.report import read_report
from legoworld.workers.sandbox import workspace_bytes


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000])
def test_a_damaged_report_is_the_programs_doing(tmp_path, text):
    (tmp_path / "report.json").write_text(text)
    assert read_report(tmp_path / "report.json").at == "program"
    assert read_report(None).at is None


def test_a_workspace_is_as_large_as_the_blocks_of_its_files(tmp_path):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "file").write_bytes(b"x" * 100_000)
    assert 100_000 <= workspace_bytes(tmp_path) < 200_000


def test_a_folder_that_cannot_be_listed_is_over_any_limit(tmp_path, monkeypatch):
    (tmp_path / "closed").mkdir()

    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("os.scandir", refuse)
    assert workspace_bytes(tmp_path) > 1 << 60


def test_a_folder_that_is_exchanged_for_a_link_is_not_counted(tmp_path):
    """A link to a large folder would have the limit on disk end the program, and the disk read."""
    (tmp_path / "workspace").mkdir()
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "large").write_bytes(b"x" * 1_000_000)
    with swapping(tmp_path / "workspace" / "d", tmp_path / "outside"):
        counted = {workspace_bytes(tmp_path / "workspace") for _ in range(SWAPS)}
    assert max(counted) < 1_000_000
