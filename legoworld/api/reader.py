"""Reading scenes again and again from one process: a pool of warm Blender workers."""

from __future__ import annotations

import queue
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from legoworld.api.scenes import Scene, SceneView
from legoworld.api.settings import (
    MEMORY_LIMIT_GIB,
    TIME_LIMIT_S,
    Cache,
    limits_of,
    protocol_of,
    snapshot_cache,
)
from legoworld.errors import LegoWorldError, UsageError
from legoworld.running.inspection import open_scene
from legoworld.running.wall import judged
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import Source, find_scene
from legoworld.tracks.track import Track
from legoworld.visibility.library import library
from legoworld.workers.processors import usable_cores

#: Scenes that wait for each worker: enough that none is idle, few enough to forget early.
_AHEAD: Final = 2


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One scene's result. status: as in a run's per_image.jsonl; "ok" has a view, others an error.

    scene: the folder as it was given.
    """

    scene: Path
    status: str
    view: SceneView | None
    error: LegoWorldError | None

    @property
    def ok(self) -> bool:
        """Whether the scene was read."""
        return self.error is None


class Reader:
    """Reads scene folders with Blender processes that stay warm between calls.

        with legoworld.Reader(task="coco", workers=4) as reader:
            for reading in reader.read(folders):
                ...

    A Blender process costs half a second to start and serves thousands of scenes: keep one reader
    for as long as scenes come. One thread may call `read` at a time.
    """

    def __init__(
        self,
        *,
        task: str | None = None,
        track: Track | str | Path | None = None,
        workers: int | None = None,
        source: Source = "blend",
        cache: Cache = True,
        require_frozen: bool = False,
        time_limit_s: float = TIME_LIMIT_S,
        memory_limit_gib: float = MEMORY_LIMIT_GIB,
    ) -> None:
        """task, track: as in `Scene.view`; workers: Blender processes, None for one a core.

        Other arguments: as in `open_scene`. Processes start with the first scene they read. Raises
        UsageError, CatalogError, or KernelBuildError where the installation is broken.
        """
        library()  # a broken installation is no scene's verdict
        n = usable_cores() if workers is None else workers
        if n < 1:
            raise UsageError("there is no worker", found=f"workers={n}", expected="1 or more")
        self._protocol = protocol_of(task, track)
        self._source: Source = source
        self._cache = snapshot_cache(cache)
        self._require_frozen = require_frozen
        limits = limits_of(time_limit_s, memory_limit_gib)
        self._threads = max(1, usable_cores() // n)
        self._made = [BlenderProcess(limits) for _ in range(n)]
        self._idle: queue.LifoQueue[BlenderProcess] = queue.LifoQueue()
        for blender in self._made:
            self._idle.put(blender)
        self._pool: ThreadPoolExecutor | None = ThreadPoolExecutor(n)

    def read(
        self, scenes: Iterable[str | Path], *, size_wh: tuple[int, int] | None = None
    ) -> Iterator[Reading]:
        """Each scene's result, in the order they are done.

        scenes: folders; taken from the iterable as workers come free, so it may be endless.
        size_wh: width and height in pixels of every view, the scene's own when None.

        What a scene causes is its `Reading`; what is this machine's (a full disk) is raised.
        """
        if self._pool is None:
            raise UsageError("the reader is closed", next_step="make another Reader")
        pool, folders = self._pool, iter(scenes)
        pending: set[Future[Reading]] = set()
        try:
            while True:
                free = _AHEAD * len(self._made) - len(pending)
                pending |= {
                    pool.submit(self._read, Path(f), size_wh) for f in islice(folders, free)
                }
                if not pending:
                    return
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                while done:  # a result is let go of as soon as it is handed out
                    yield done.pop().result()
        finally:
            for future in pending:
                future.cancel()

    def close(self) -> None:
        """End the Blender processes, whatever they are doing."""
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
            view = Scene(opened).view_by(self._protocol, size_wh, self._threads)
        except Exception as error:  # noqa: BLE001  a verdict of this scene, or raised again
            verdict = judged(error, [self._cache.folder] if self._cache else [])
            return Reading(scene=folder, status=verdict.status, view=None, error=verdict)
        finally:
            self._idle.put(blender)
        return Reading(scene=folder, status="ok", view=view, error=None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
