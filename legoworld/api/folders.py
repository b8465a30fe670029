"""Folders that are read and written, here or at a URL: what is elsewhere is worked on as a copy."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from legoworld.errors import UsageError
from legoworld.remote import Place, fetch_folder, is_url, publish_folder
from legoworld.scene.cache import default_cache_folder
from legoworld.workers.scratch import scratch_folder


def place_of(folder: str | Path) -> Place:
    """A path or a URL as the rest of the package takes it."""
    return folder if isinstance(folder, str) and is_url(folder) else Path(folder)


@contextmanager
def written_at(place: Place, *, last: str, overwrite: bool) -> Iterator[Path]:
    """A folder to write into; when `place` is a URL, published there even after a failure.

    What is at the URL is fetched first, so that the same command goes on where it stopped, on any
    machine. The folder here goes once it is published; it outlives only a kill, and is then what
    the next command goes on from.
    """
    if isinstance(place, Path):
        yield place
        return
    name = hashlib.sha256(place.encode("utf-8")).hexdigest()[:16]
    folder = default_cache_folder() / "published" / name
    if not overwrite and not folder.exists():
        fetch_folder(place, folder)
    try:
        yield folder
    finally:
        if folder.is_dir():
            publish_folder(folder, place, last=last)
            shutil.rmtree(folder)


@contextmanager
def written_whole(place: Place, *, last: str) -> Iterator[Path]:
    """A folder to write into; when `place` is a URL, published there only when all went well.

    What is at the URL is fetched first, to be looked at before it is replaced.
    """
    if isinstance(place, Path):
        yield place
        return
    with scratch_folder("legoworld-written-") as folder:
        local = folder / (place.rstrip("/").rpartition("/")[2] or "written")
        fetch_folder(place, local)
        yield local
        publish_folder(local, place, last=last)


@contextmanager
def read_from(place: Place) -> Iterator[Path]:
    """A folder to read from: what is at a URL is fetched for as long as the block lasts."""
    if isinstance(place, Path):
        yield place
        return
    with scratch_folder("legoworld-fetched-") as folder:
        local = folder / (place.rstrip("/").rpartition("/")[2] or "fetched")
        if not fetch_folder(place, local):
            raise UsageError(f"there is nothing at {place}", next_step="correct the URL")
        yield local
