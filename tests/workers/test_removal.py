"""Folders that untrusted programs have filled are removed, and nothing beside them."""

from __future__ import annotations

import os
from pathlib import Path

from legoworld.workers.removal import remove_folder


def test_links_are_removed_and_not_followed(tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "file").write_text("x")
    folder = tmp_path / "folder"
    (folder / "a" / "b").mkdir(parents=True)
    (folder / "a" / "link").symlink_to(kept)
    (folder / "up").symlink_to("..")
    os.mkfifo(folder / "a" / "fifo")
    remove_folder(folder)
    assert not folder.exists()
    assert (kept / "file").read_text() == "x"


def test_a_link_in_the_folders_place_is_not_followed(tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "file").touch()
    (tmp_path / "folder").symlink_to(kept)
    remove_folder(tmp_path / "folder")
    assert (kept / "file").exists()


def test_folders_without_permissions_and_deep_ones_go(tmp_path):
    folder = tmp_path / "folder"
    shut = folder / "shut"
    (shut / "inner").mkdir(parents=True)
    (shut / "inner" / "file").touch()
    (shut / "inner").chmod(0)
    shut.chmod(0)
    nest(folder, 3000)
    remove_folder(folder)
    assert not folder.exists()


def nest(folder: Path, depth: int) -> None:
    """Folders in folders, deeper than a path can be."""
    at = os.open(folder, os.O_RDONLY)
    for _ in range(depth):
        os.mkdir("deeper", dir_fd=at)
        below = os.open("deeper", os.O_RDONLY, dir_fd=at)
        os.close(at)
        at = below
    os.close(at)
