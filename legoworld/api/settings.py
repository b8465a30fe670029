"""Arguments shared by what reads scenes: the cache, limits of a Blender process, the protocol."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Final

from legoworld.api.arguments import check_argument
from legoworld.api.by_task import task_entry
from legoworld.errors import UsageError
from legoworld.readouts.family import Protocol, protocol
from legoworld.scene.blender_process import Limits
from legoworld.scene.cache import SnapshotCache, default_cache_folder
from legoworld.tracks.track import Track, load_track, serves

#: The snapshot cache folder; True for the user's own (or $LEGOWORLD_CACHE), False for none.
Cache = bool | str | Path

TIME_LIMIT_S: Final = 120.0
MEMORY_LIMIT_GIB: Final = 8.0


def snapshot_cache(cache: Cache) -> SnapshotCache | None:
    """The SnapshotCache for a `cache` argument."""
    if cache is False:
        return None
    return SnapshotCache(default_cache_folder() if cache is True else Path(cache))


#: A track or its file; for several tasks also a folder with <task>.json, or a mapping by task.
Tracks = Track | str | Path | Mapping[str, Track | str | Path] | None


def tracks_by_task(tasks: Sequence[str], given: Tracks) -> dict[str, Track]:
    """The track of each task, of those that have one. UsageError for one made for another task."""
    tracks: dict[str, Track] = {}
    if given is None:
        return tracks
    for task in tasks:
        own: Track | str | Path
        if isinstance(given, Mapping):
            if task not in given:
                raise UsageError(f"there is no track of {task}", found=", ".join(given))
            own = given[task]
        elif isinstance(given, str | Path) and Path(given).is_dir():
            own = task_entry(Path(given), task, "track")
        else:
            own = given
        tracks[task] = open_track(own)
        refuse_other_task(tracks[task], task)
    return tracks


def make_limits(time_limit_s: float, memory_limit_gib: float) -> Limits:
    """Limits of a Blender process. Raises UsageError unless both are above 0."""
    check_argument("time_limit_s", time_limit_s)
    check_argument("memory_limit_gib", memory_limit_gib)
    return Limits(time_s=time_limit_s, memory_bytes=int(memory_limit_gib * 2**30))


def open_track(track: Track | str | Path) -> Track:
    """A track, loaded if it is a path. Raises CatalogError."""
    return track if isinstance(track, Track) else load_track(Path(track))


@cache
def _protocol(task: str) -> Protocol:
    """A task's protocol with the shipped vocabulary, read once: its files do not change."""
    return protocol(task, None)


def load_protocol(task: str | None, track: Track | str | Path | None) -> Protocol | None:
    """The protocol of a task with a track's vocabulary; the track may also record the task.

    None without either. UsageError if the task is unknown, or several, or the track was made for
    another task.
    """
    if not isinstance(task, str | None):
        raise UsageError("one view is of one task", found=repr(task)[:100], expected="its name")
    if track is None:
        return None if task is None else _protocol(task)
    images = open_track(track)
    chosen = task or images.made_for
    if chosen is None:
        raise UsageError("the track does not record its task", next_step="pass the task as well")
    refuse_other_task(images, chosen)
    return protocol(chosen, images.vocabulary)


def refuse_other_task(track: Track, task: str) -> None:
    """Raise UsageError for a track that was made for another task."""
    if not serves(track, task):
        raise UsageError(
            f"the track was made for {track.made_for}, not for {task}",
            next_step=f"make one with `legoworld track make --task {task}`",
        )
