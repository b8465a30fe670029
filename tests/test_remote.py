"""Names from a store, and faults of this machine that are not the store's."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from legoworld.api import folders
from legoworld.remote import PlaceError, fetch_folder

fsspec = pytest.importorskip("fsspec")


@pytest.fixture
def url() -> str:
    system = fsspec.filesystem("memory")
    system.rm("/", recursive=True)
    system.pipe_file("/bucket/scene/scene.blend", b"scene")
    return "memory://bucket"


@pytest.mark.parametrize("name", ["../escaped", "scene/../../escaped", "scene//x", "./x"])
def test_a_name_that_leads_out_is_refused_and_nothing_is_written(name, url, tmp_path, monkeypatch):
    monkeypatch.setattr("legoworld.remote._names_below", lambda *_a: [name, "scene/scene.blend"])
    with pytest.raises(PlaceError, match="not a path inside its folder"):
        fetch_folder(url, tmp_path / "into")
    assert list(tmp_path.iterdir()) == []


def test_whole_names_are_fetched(url, tmp_path):
    assert fetch_folder(url, tmp_path / "into") == 1
    assert (tmp_path / "into" / "scene" / "scene.blend").read_bytes() == b"scene"


def test_a_full_disk_here_is_not_the_urls_fault(url, tmp_path, monkeypatch):
    def full(*_arguments: object, **_named: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(type(fsspec.filesystem("memory")), "get_file", full)
    with pytest.raises(OSError, match="No space left"):
        fetch_folder(url, tmp_path / "into")


def test_a_folder_that_cannot_be_made_here_is_not_the_urls_fault(url, tmp_path):
    (tmp_path / "into").write_text("a file")
    with pytest.raises(OSError, match=r"exists|Not a directory"):
        fetch_folder(url, tmp_path / "into")


def test_what_is_published_is_kept_inside_the_chosen_cache(tmp_path, monkeypatch, url):
    monkeypatch.setenv("LEGOWORLD_CACHE", str(tmp_path / "cache"))
    with folders.written_at(f"{url}/run", last="run.json") as folder:
        assert Path(folder).is_relative_to(tmp_path / "cache")
        Path(folder).mkdir(parents=True)
        (Path(folder) / "run.json").write_text("{}")
