"""--overwrite at a URL deletes what it deletes in a local folder: the run's own files."""

from __future__ import annotations

from pathlib import Path

import pytest

from legoworld import cli

fsspec = pytest.importorskip("fsspec")
READ = ["readout", "--task", "coco", "--limit", "1", "--no-cache", "-q"]


def names(place: str) -> set[str]:
    if "://" not in place:
        return {p.name for p in Path(place).iterdir() if p.name != ".lock"}
    system, top = fsspec.core.url_to_fs(place)
    return {name.rpartition("/")[2] for name in system.find(top)}


def write(place: str, name: str) -> None:
    with fsspec.open(f"{place}/{name}", "wb") as stream:
        stream.write(b"mine")


@pytest.mark.blender
def test_files_of_others_stay(tmp_path, monkeypatch):
    monkeypatch.setenv("LEGOWORLD_CACHE", str(tmp_path / "cache"))
    found = {}
    for place in (str(tmp_path / "run"), "memory://overwriting/run"):
        assert cli.run([*READ, "-o", place]) == 0
        before = names(place)
        write(place, "notes.txt")
        assert cli.run([*READ, "-o", place, "--overwrite"]) == 0
        found[place] = (before, names(place))
    local, remote = found.values()
    assert local == remote
    assert "notes.txt" in remote[1]


@pytest.mark.blender
def test_a_folder_that_is_no_run_is_refused_and_left(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("LEGOWORLD_CACHE", str(tmp_path / "cache"))
    for place in (str(tmp_path / "notes"), "memory://overwriting/notes"):
        if "://" not in place:
            Path(place).mkdir()
        write(place, "notes.txt")
        assert cli.run([*READ, "-o", place, "--overwrite"]) == 2
        assert "not a run" in capsys.readouterr().err
        assert names(place) == {"notes.txt"}
