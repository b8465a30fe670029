"""Entries of the snapshot cache: their keys, and the files that a scene file reads."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from legoworld.scene import cache as cache_module
from legoworld.scene.cache import SnapshotCache, bpy_version, default_cache_folder
from legoworld.scene.freeze import FileHash

SHA = "a" * 64


@pytest.fixture
def cache(tmp_path):
    return SnapshotCache(tmp_path / "cache")


def test_what_a_scene_file_reads_is_remembered(cache, tmp_path):
    scene = tmp_path / "scene"
    (scene / "baked" / "deep").mkdir(parents=True)
    (scene / "baked" / "deep" / "1.bphys").write_text("")
    (scene / "baked" / "0.bphys").write_text("")
    assert cache.dependencies(SHA, scene) is None
    cache.put_dependencies(SHA, ["z.png", "../a.png", "baked/0.bphys"], ["baked", "never"])
    assert cache.dependencies(SHA, scene) == [
        "../a.png", "baked/0.bphys", "baked/deep/1.bphys", "z.png",
    ]  # fmt: skip
    assert cache.dependencies("b" * 64, scene) is None


@pytest.mark.parametrize(
    "text", ["{", "[]", "{}", '{"files": []}', '{"files": 3, "watched": []}', "\0\xff"]
)
def test_a_damaged_entry_is_one_that_is_not_there(text, cache, tmp_path):
    cache.put_dependencies(SHA, [], [])
    (entry,) = cache.folder.rglob("*.json")
    assert json.loads(entry.read_text()) == {"files": [], "watched": []}
    entry.write_text(text, encoding="latin-1")
    assert cache.dependencies(SHA, tmp_path) is None


def test_a_snapshot_is_found_by_all_that_it_was_made_from(cache):
    one, other = FileHash(sha256="1", bytes=1), FileHash(sha256="2", bytes=1)
    given = [
        (SHA, {}), ("b" * 64, {}), (SHA, {"x": one}), (SHA, {"y": one}), (SHA, {"x": other}),
        (SHA, {"x": None}),
    ]  # fmt: skip
    paths = [cache.snapshot_path(sha256, files) for sha256, files in given]
    assert len(set(paths)) == len(paths)
    assert all(p.suffix == ".snapshot" and p.is_relative_to(cache.folder) for p in paths)
    assert cache.snapshot_path(SHA, {"x": one}) == cache.snapshot_path(
        SHA, {"x": FileHash(sha256="1", bytes=9, stamp=(1,))}
    )


@pytest.mark.parametrize("name", ["reader_sha256", "bpy_version"])
def test_another_reader_and_another_blender_find_nothing_old(name, cache, tmp_path, monkeypatch):
    cache.put_dependencies(SHA, [], [])
    paths = {cache.snapshot_path(SHA, {}), cache.entry_path(SHA, ".png")}
    monkeypatch.setattr(cache_module, name, lambda: "another")
    assert cache.dependencies(SHA, tmp_path) is None
    assert not paths & {cache.snapshot_path(SHA, {}), cache.entry_path(SHA, ".png")}


def test_an_answer_is_found_by_its_content_and_kind(cache):
    paths = [
        cache.entry_path(SHA, ".png"),
        cache.entry_path(SHA, ".npz"),
        cache.entry_path("b", ".png"),
    ]
    assert len(set(paths)) == 3
    assert [p.suffix for p in paths] == [".png", ".npz", ".png"]


def test_the_cache_lies_where_the_environment_says(tmp_path, monkeypatch):
    monkeypatch.setenv("LEGOWORLD_CACHE", str(tmp_path))
    assert default_cache_folder() == tmp_path
    monkeypatch.setenv("LEGOWORLD_CACHE", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    found = default_cache_folder()
    assert (found.name, found.parent.name) == ("snapshots", "legoworld")


def test_the_version_of_blender_is_read_from_its_metadata(tmp_path, monkeypatch):
    def version_on(*places: Path) -> str:
        monkeypatch.setattr(sys, "path", [str(place) for place in places])
        return bpy_version.__wrapped__()

    first, second = tmp_path / "first", tmp_path / "second"
    (first / "other-1.0.dist-info").mkdir(parents=True)
    assert version_on(first) == "not installed"
    (second / "bpy-9.8.7.dist-info").mkdir(parents=True)
    assert version_on(first, second) == "9.8.7"
    monkeypatch.chdir(second)
    monkeypatch.setattr(sys, "path", [""])
    assert bpy_version.__wrapped__() == "9.8.7"
