"""Reading images in processes instead of threads, for machines of many cores.

Half of what an image from the cache costs is Python, so threads of one process get no further than
two or three cores; the other half, the kernel's, runs beside it.
"""

from __future__ import annotations

from typing import Final

from legoworld.errors import WorkerCrashedError
from legoworld.records.run_file import ImageRecord
from legoworld.running.image import SceneReader
from legoworld.running.image_record import ImageOptions, failed_record
from legoworld.scene.blender_process import Limits
from legoworld.tracks.track import TrackImage
from legoworld.workers.task_process import ProcessLostError, TaskProcess

#: Images that are worth starting a process for, each.
_WORTH_A_PROCESS: Final = 30
#: Up to so many threads hardly wait for each other.
_MOST_THREADS: Final = 2


def worth_processes(workers: int, n_images: int) -> bool:
    """Whether so many workers of this machine should be processes."""
    return workers > _MOST_THREADS and n_images >= _WORTH_A_PROCESS * workers


class ReaderProcess:
    """A SceneReader in a process of its own."""

    def __init__(self, options: ImageOptions, limits: Limits) -> None:
        self._process: TaskProcess[TrackImage, ImageRecord] = TaskProcess(_Read(options, limits))
        self._aborted = False

    def do(self, image: TrackImage) -> ImageRecord:
        """One image's record. A process that ends is replaced and asked once more."""
        try:
            return self._process.call(image)
        except ProcessLostError as error:
            if self._aborted:
                return _lost(image, error)
        try:
            return self._process.call(image)
        except ProcessLostError as error:
            return _lost(image, error)

    def abort(self) -> None:
        """End the process under a running `do`; Blender ends with it."""
        self._aborted = True
        self._process.abort()

    def close(self) -> None:
        """End the process."""
        self._process.close()


class _Read:
    """What the process calls: made here, its reader is made where it is first called."""

    def __init__(self, options: ImageOptions, limits: Limits) -> None:
        self._options = options
        self._limits = limits
        self._reader: SceneReader | None = None

    def __call__(self, image: TrackImage) -> ImageRecord:
        if self._reader is None:
            self._reader = SceneReader(self._options, self._limits)
        return self._reader.do(image)


def _lost(image: TrackImage, error: ProcessLostError) -> ImageRecord:
    return failed_record(
        image,
        WorkerCrashedError(
            "the process that read the scene ended, twice",
            found=error.found,
            expected="a record of the scene",
            next_step="run the same command again, with fewer --workers where memory is short",
        ),
    )
