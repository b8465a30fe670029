"""Reading many scenes from one process: a pool of warm Blender workers."""

from __future__ import annotations

import queue
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Final, Self

from legoworld.api.arguments import check_argument, check_arguments
from legoworld.api.scenes import Scene, SceneView
from legoworld.api.settings import (
    MEMORY_LIMIT_GIB,
    TIME_LIMIT_S,
    Cache,
    Tracks,
    load_protocol,
    make_limits,
    snapshot_cache,
    tracks_by_task,
)
from legoworld.errors import LegoWorldError, Raised, UsageError
from legoworld.readouts.protocol import Protocol
from legoworld.running.error_boundary import classify_error
from legoworld.running.inspection import open_scene
from legoworld.running.scene_views import SceneViews
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import Source, find_scene
from legoworld.visibility.library import library
from legoworld.workers.processors import usable_cores

#: Scenes queued per worker: enough to keep it busy, few enough to stop early.
_AHEAD: Final = 2


@dataclass(frozen=True, kw_only=True)
class Reading:
    """The result of one scene. status: as in per_image.jsonl; "ok" has a view, others an error.

    scene: the folder as it was passed; views: of each task the reader was made for, by its name;
    view: of the first, or of every label where the reader has no task.
    """

    scene: Path
    status: str
    view: SceneView | None
    error: LegoWorldError | None
    views: Mapping[str, SceneView] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the scene was read."""
        return self.error is None


class Reader:
    """Reads scene folders with Blender processes that stay warm between calls.

        with legoworld.Reader(task="coco", workers=4) as reader:
            for reading in reader.read(folders):
                ...

    A Blender process takes half a second to start and can read thousands of scenes, so keep one
    reader for all scenes. Only one thread at a time may call `read`.
    """

    @check_arguments
    def __init__(
        self,
        *,
        task: str | list[str] | tuple[str, ...] | None = None,
        track: Tracks = None,
        workers: int | None = None,
        source: Source = "blend",
        cache: Cache = True,
        require_frozen: bool = False,
        time_limit_s: float = TIME_LIMIT_S,
        memory_limit_gib: float = MEMORY_LIMIT_GIB,
    ) -> None:
        """task: as in `Scene.view`, or several, which share what is drawn of a scene.

        track: as in `Scene.view`; of several tasks as in `readout`. workers: Blender processes,
        None for one per core. Other arguments: as in `open_scene`. Processes start with the first
        scene they read. Raises UsageError, CatalogError, or KernelBuildError if the installation is
        broken.
        """
        library()  # a broken installation is not the scene's fault
        n = usable_cores() if workers is None else workers
        self._protocols = _protocols(task, track)
        self._source: Source = source
        self._cache = snapshot_cache(cache)
        self._require_frozen = require_frozen
        limits = make_limits(time_limit_s, memory_limit_gib)
        self._threads = max(1, usable_cores() // n)
        self._made = [BlenderProcess(limits) for _ in range(n)]
        self._idle: queue.LifoQueue[BlenderProcess] = queue.LifoQueue()
        for blender in self._made:
            self._idle.put(blender)
        self._pool: ThreadPoolExecutor | None = ThreadPoolExecutor(n)

    def read(
        self, scenes: Iterable[str | Path], *, size_wh: tuple[int, int] | None = None
    ) -> Iterator[Reading]:
        """Yield the result of each scene, in order of completion.

        scenes: folders; taken from the iterable as workers become free, so it may be endless.
        size_wh: width and height in pixels of every view; None uses the scene's own.
        A scene's errors are part of its `Reading`; this machine's (a full disk) are raised.
        """
        if self._pool is None:
            raise UsageError("the reader is closed", next_step="create a new Reader")
        check_argument("size_wh", size_wh)
        if isinstance(scenes, str | Path) or not isinstance(scenes, Iterable):
            raise UsageError(
                "a reader reads several scenes", found=repr(scenes)[:100], expected="their folders"
            )
        pool, folders = self._pool, iter(scenes)
        pending: set[Future[Reading]] = set()
        try:
            while True:
                free = _AHEAD * len(self._made) - len(pending)
                pending |= {
                    pool.submit(self._read, _folder(f), size_wh) for f in islice(folders, free)
                }
                if not pending:
                    return
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                while done:  # drop the reference to a result once it is yielded
                    yield done.pop().result()
        finally:
            for future in pending:
                future.cancel()

    def close(self) -> None:
        """End the Blender processes, even while they are reading."""
        if self._pool is None:
            return
        for blender in self._made:
            blender.abort()
        self._pool.shutdown(cancel_futures=True)
        self._pool = None
        for blender in self._made:
            blender.close()

    def _read(self, folder: Path, size_wh: tuple[int, int] | None) -> Reading:
        blender = self._idle.get()
        try:
            path = folder.resolve()
            opened = open_scene(
                find_scene(path.parent, path.name),
                source=self._source,
                blender=blender,
                cache=self._cache,
                require_frozen=self._require_frozen,
            )
            seen = self._views(Scene(opened), size_wh)
        except Exception as error:  # noqa: BLE001  a verdict of this scene, or raised again
            verdict = classify_error(error, [self._cache.folder] if self._cache else [])
            return Reading(scene=folder, status=verdict.status, view=None, error=verdict)
        finally:
            self._idle.put(blender)
        named = {
            protocol.task.name: view
            for protocol, view in zip(self._protocols, seen, strict=True)
            if protocol is not None
        }
        return Reading(scene=folder, status="ok", view=seen[0], error=None, views=named)

    def _views(self, scene: Scene, size_wh: tuple[int, int] | None) -> list[SceneView]:
        """The scene's view by each protocol; those of equal instances are drawn once."""
        drawn = SceneViews()
        return [scene.view_by(one, size_wh, self._threads, drawn) for one in self._protocols]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        self.close()


def _protocols(task: str | Sequence[str] | None, track: Tracks) -> list[Protocol | None]:
    if task is None:
        if isinstance(track, Mapping):
            raise UsageError("tracks by task need their tasks", next_step="pass task=[...] as well")
        return [load_protocol(None, track)]
    tasks = [task] if isinstance(task, str) else list(task)
    if not tasks:
        raise UsageError("a reader of several tasks needs one", found="an empty list")
    tracks = tracks_by_task(tasks, track)
    return [load_protocol(one, tracks.get(one)) for one in tasks]


def _folder(scene: str | Path) -> Path:
    check_argument("folder", scene)
    return Path(scene)
