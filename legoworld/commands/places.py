"""Arguments that name a folder here or at a URL, and how a command works with the latter."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import click

from legoworld.commands import options
from legoworld.places import Place, fetch_folder, is_url, publish_folder
from legoworld.scene.scratch import scratch_folder


class PlaceType(click.ParamType[Place]):
    """A folder's path, or its URL. file:// is a path."""

    name = "folder or url"

    def __init__(self, *, exists: bool) -> None:
        self._path = options.EXISTING_FOLDER if exists else options.FOLDER

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Place:
        """Text to a path, or to a URL as it is."""
        if isinstance(value, str) and is_url(value):
            if urlsplit(value).scheme != "file":
                return value
            value = unquote(urlsplit(value).path)
        path: Path = self._path.convert(value, param, ctx)
        return path


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
    from legoworld.scene.cache import default_cache_folder

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
            raise click.UsageError(f"there is nothing at {place}")
        yield local
