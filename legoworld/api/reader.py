"""Reading many scenes from one process: a pool of warm Blender workers."""

from __future__ import annotations

import asyncio
import queue
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, Literal, Self

from legoworld.api.arguments import check_argument, check_arguments
from legoworld.api.cameras import AnyCamera
from legoworld.api.scene_view import SceneView
from legoworld.api.scenes import Scene
from legoworld.api.scoring import Truth, score
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
from legoworld.api.views import Views
from legoworld.errors import LegoWorldError, Raised, UsageError
from legoworld.evaluation.family import Scores
from legoworld.readouts.family import Protocol
from legoworld.running.error_boundary import classify_error
from legoworld.running.inspection import open_scene
from legoworld.running.scene_views import SceneViews
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import Source, scene_at
from legoworld.tasks.shipped import TaskName
from legoworld.visibility.library import library
from legoworld.workers.processors import usable_cores

#: Scenes queued per worker: enough to keep it busy, few enough to stop early.
_AHEAD: Final = 2


@dataclass(frozen=True, kw_only=True)
class Ok:
    """A scene that was read. scene: as it was passed.

    view: of the first task, or of every label where the reader has no task; views: of each task
    the reader was made for, by its name. image_id, scores: of a reader with a truth.
    """

    scene: Path
    view: SceneView
    views: Mapping[str, SceneView] = field(default_factory=dict)
    image_id: int | None = None
    scores: Scores | None = None
    status: Literal["ok"] = "ok"
    error: None = None
    ok: Literal[True] = True


@dataclass(frozen=True, kw_only=True)
class Failed:
    """A scene that could not be read. status: as in per_image.jsonl; error: why."""

    scene: Path
    status: str
    error: LegoWorldError
    image_id: int | None = None
    view: None = None
    scores: None = None
    views: Mapping[str, SceneView] = field(default_factory=dict)
    ok: Literal[False] = False


#: The result of one scene; `if reading.ok` tells type checkers which.
Reading = Ok | Failed
#: What a worker does: a result, or further work of the scene that it opened.
_Job = Callable[[], "Reading | Iterator[_Job]"]


class Reader:
    """Reads scenes with Blender processes that stay warm between calls.

        with legoworld.Reader(task="coco", workers=4) as reader:
            for reading in reader.read(folders):
                ...

    A Blender process takes half a second to start and can read thousands of scenes, so keep one
    reader for all scenes. Only one thread, or coroutine, at a time may call a method.
    """

    @check_arguments
    def __init__(
        self,
        *,
        task: TaskName | str | list[str] | tuple[str, ...] | None = None,
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
        self._blenders = [BlenderProcess(limits) for _ in range(n)]
        self._idle: queue.LifoQueue[BlenderProcess] = queue.LifoQueue()
        for blender in self._blenders:
            self._idle.put(blender)
        self._pool: ThreadPoolExecutor | None = ThreadPoolExecutor(n)

    def read(
        self, scenes: Iterable[str | Path], *, size_wh: tuple[int, int] | None = None
    ) -> Iterator[Reading]:
        """Yield the result of each scene, in order of completion.

        scenes: folders, .blend or .glb files; taken from the iterable as workers become free, so it
        may be endless. size_wh: width and height in pixels of every view; None uses the scene's
        own. A scene's errors are part of its `Reading`; this machine's (a full disk) are raised.
        """
        check_argument("size_wh", size_wh)
        return self._results(self._read_job(path, size_wh) for path in _paths(scenes))

    def score(self, scenes: Mapping[int, str | Path], truth: Truth) -> Iterator[Reading]:
        """`read` the scene of each image of a ground truth, at the image's size, and score it.

        scenes: by image id; `scores` of each result are those of its image alone. The views of a
        task that the truth is not of are not scored. Raises UsageError for an unknown image.
        """
        sizes = truth.sizes_wh
        unknown = [image_id for image_id in scenes if image_id not in sizes]
        if unknown:
            raise UsageError(
                "the truth has no such image",
                found=repr(unknown[0])[:100],
                expected=f"one of its {len(sizes)} images",
            )
        return self._results(
            self._read_job(_path(path), sizes[image_id], image_id, truth)
            for image_id, path in scenes.items()
        )

    def map(
        self,
        scenes: Iterable[str | Path],
        cameras: Sequence[AnyCamera],
        *,
        size_wh: tuple[int, int] | None = None,
    ) -> Iterator[Reading]:
        """Yield the result of each scene through each camera, in order of completion.

        Scenes and cameras share one queue: workers draw views of a scene that is open while others
        are opened. cameras: as in `Scene.views`, `view.camera.name` tells which; a scene without a
        camera of that name is one failed `Reading`. The views are of the reader's first task.
        """
        check_argument("size_wh", size_wh)
        return self._results(
            partial(self._open_jobs, path, cameras, size_wh) for path in _paths(scenes)
        )

    async def aread(
        self, scenes: Iterable[str | Path], *, size_wh: tuple[int, int] | None = None
    ) -> AsyncIterator[Reading]:
        """`read` for asyncio: the event loop is free while scenes are read."""
        readings = self.read(scenes, size_wh=size_wh)
        try:
            while (reading := await asyncio.to_thread(next, readings, None)) is not None:
                yield reading
        finally:
            readings.close()  # type: ignore[attr-defined]

    def close(self) -> None:
        """End the Blender processes, even while they are reading."""
        if self._pool is None:
            return
        for blender in self._blenders:
            blender.abort()
        self._pool.shutdown(cancel_futures=True)
        self._pool = None
        for blender in self._blenders:
            blender.close()

    def _results(self, scenes: Iterator[_Job]) -> Iterator[Reading]:
        """The results of jobs, a few at a time; views of open scenes come before new scenes."""
        if self._pool is None:
            raise UsageError("the reader is closed", next_step="create a new Reader")
        return self._run(self._pool, scenes)

    def _run(self, pool: ThreadPoolExecutor, scenes: Iterator[_Job]) -> Iterator[Reading]:
        pending: set[Future[Reading | Iterator[_Job]]] = set()
        open_scenes: deque[Iterator[_Job]] = deque()
        try:
            while True:
                while len(pending) < _AHEAD * len(self._blenders):
                    job = _next_job(open_scenes) or next(scenes, None)
                    if job is None:
                        break
                    pending.add(pool.submit(job))
                if not pending:
                    return
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                while done:  # drop the reference to a result once it is yielded
                    result = done.pop().result()
                    if isinstance(result, Ok | Failed):
                        yield result
                    else:
                        open_scenes.append(result)
                    del result
        finally:
            for future in pending:
                future.cancel()

    def _read_job(
        self,
        scene: Path,
        size_wh: tuple[int, int] | None,
        image_id: int | None = None,
        truth: Truth | None = None,
    ) -> _Job:
        def read() -> Reading:
            try:
                seen = self._views(self._open(scene), size_wh)
                scores = None
                if truth is not None and image_id is not None:
                    of_truth = [view for view in seen if view.task == truth.task]
                    scores = score(of_truth[0], truth, image_id=image_id) if of_truth else None
            except Exception as error:  # noqa: BLE001  a verdict of this scene, or raised again
                return self._failure(scene, error, image_id)
            named = {view.task: view for view in seen if view.task is not None}
            return Ok(scene=scene, view=seen[0], views=named, image_id=image_id, scores=scores)

        return read

    def _open_jobs(
        self, path: Path, cameras: Sequence[AnyCamera], size_wh: tuple[int, int] | None
    ) -> Reading | Iterator[_Job]:
        """The jobs that draw a scene through cameras, once it is open."""
        try:
            scene = self._open(path)
            views = scene.views_by(self._protocols[0], cameras, size_wh, workers=1)
        except Exception as error:  # noqa: BLE001  a verdict of this scene, or raised again
            return self._failure(path, error)
        return (partial(self._draw_view, path, views, camera) for camera in range(len(views)))

    def _draw_view(self, path: Path, views: Views, camera: int) -> Reading:
        try:
            view = views[camera]
        except Exception as error:  # noqa: BLE001  a verdict of this scene, or raised again
            return self._failure(path, error)
        named = {view.task: view} if view.task is not None else {}
        return Ok(scene=path, view=view, views=named)

    def _open(self, scene: Path) -> Scene:
        blender = self._idle.get()
        try:
            folder, source = scene_at(scene, self._source)
            return Scene(
                open_scene(
                    folder,
                    source=source,
                    blender=blender,
                    cache=self._cache,
                    require_frozen=self._require_frozen,
                    any_camera=True,
                )
            )
        finally:
            self._idle.put(blender)

    def _failure(self, scene: Path, error: Exception, image_id: int | None = None) -> Failed:
        verdict = classify_error(error, [self._cache.folder] if self._cache else [])
        return Failed(scene=scene, status=verdict.status, error=verdict, image_id=image_id)

    def _views(self, scene: Scene, size_wh: tuple[int, int] | None) -> list[SceneView]:
        """The scene's view by each protocol; those of equal instances are drawn once."""
        drawn = SceneViews()
        return [scene.view_by(one, size_wh, self._threads, drawn) for one in self._protocols]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        self.close()


def _next_job(open_scenes: deque[Iterator[_Job]]) -> _Job | None:
    while open_scenes:
        job = next(open_scenes[0], None)
        if job is not None:
            return job
        open_scenes.popleft()
    return None


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


def _paths(scenes: Iterable[str | Path]) -> Iterator[Path]:
    if isinstance(scenes, str | Path) or not isinstance(scenes, Iterable):
        raise UsageError(
            "a reader reads several scenes", found=repr(scenes)[:100], expected="their paths"
        )
    return map(_path, scenes)


def _path(scene: str | Path) -> Path:
    check_argument("folder", scene)
    return Path(scene)
