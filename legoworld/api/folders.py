"""Input and output folders, local or at a URL: remote ones are worked on as a local copy."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from legoworld.api.listener import Listener
from legoworld.errors import UsageError
from legoworld.pluralize import first_few, plural
from legoworld.remote import Place, fetch_folder, is_url, publish_folder
from legoworld.scene.cache import default_cache_folder, unwritable, why_unwritable
from legoworld.tracks.track import folders_without_scene
from legoworld.workers.scratch import scratch_folder


def parse_place(folder: str | Path) -> Place:
    """A path or URL in the form the rest of the package takes."""
    return folder if isinstance(folder, str) and is_url(folder) else Path(folder)


def note_folders_without_scene(scenes: Path, listener: Listener) -> None:
    """Name the folders that a track would have made rows of: without one they are no scenes."""
    bare = folders_without_scene(scenes)
    if bare:
        held = plural(len(bare), "folder holds", "folders hold")
        listener.notice(
            f"{held} files of a scene but no scene.blend or scene.glb: {first_few(bare, 3)}"
        )


@contextmanager
def written_at(place: Place, *, last: str) -> Iterator[Path]:
    """A folder to write into; if `place` is a URL, it is published there even after a failure.

    The URL's content is fetched first, so that the same command resumes on any machine, and so that
    what is deleted there is what the same command deletes in a local folder. The local folder is
    deleted once published; only a kill leaves it behind, and the next command resumes from it.
    CacheFolderError without a place for it.
    """
    if isinstance(place, Path):
        yield place
        return
    name = hashlib.sha256(place.encode("utf-8")).hexdigest()[:16]
    cache = default_cache_folder()
    if why := why_unwritable(cache):
        raise unwritable(cache, why)
    folder = cache / "published" / name
    if not folder.exists():
        fetch_folder(place, folder)
    try:
        yield folder
    finally:
        if folder.is_dir():
            publish_folder(folder, place, last=last)
            shutil.rmtree(folder)


@contextmanager
def written_whole(place: Place, *, last: str) -> Iterator[Path]:
    """A folder to write into; if `place` is a URL, it is published there only on success.

    The URL's content is fetched first, to be checked before it is replaced.
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
    """A folder to read from; a URL is fetched for the duration of the block.

    Raises UsageError where there is nothing at the URL.
    """
    if isinstance(place, Path):
        yield place
        return
    with scratch_folder("legoworld-fetched-") as folder:
        local = folder / (place.rstrip("/").rpartition("/")[2] or "fetched")
        if not fetch_folder(place, local):
            raise UsageError(f"{place} is empty or does not exist", next_step="correct the URL")
        yield local
