"""Reading images in processes instead of threads, for machines with many cores.

Half of the cost of a cached image is Python, so threads of one process scale only to two or three
cores; the other half, the kernel's, runs in parallel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from legoworld.errors import WorkerCrashedError
from legoworld.running.image import Answers, Questions, SceneReader
from legoworld.running.image_record import ImageOptions, failed_record
from legoworld.scene.blender_process import Limits
from legoworld.workers.task_process import ProcessLostError, TaskProcess

#: Minimum number of images per process that is worth starting one.
_WORTH_A_PROCESS: Final = 30
#: Up to this number, threads hardly wait for each other.
_MOST_THREADS: Final = 2


def worth_processes(workers: int, n_images: int, cores: int) -> bool:
    """Whether this number of local workers should be processes."""
    return min(workers, cores) > _MOST_THREADS and n_images >= _WORTH_A_PROCESS * workers


class ReaderProcess:
    """A SceneReader in a separate process."""

    def __init__(self, options: Sequence[ImageOptions], limits: Limits) -> None:
        self._process: TaskProcess[Questions, Answers] = TaskProcess(_ReadFunction(options, limits))
        self._aborted = False

    def do(self, questions: Questions) -> Answers:
        """The records of one scene folder. If the process ends, a new one retries once."""
        try:
            return self._process.call(questions)
        except ProcessLostError as error:
            if self._aborted:
                return _lost_record(questions, error)
        try:
            return self._process.call(questions)
        except ProcessLostError as error:
            return _lost_record(questions, error)

    def abort(self) -> None:
        """End the process during a running `do`; Blender ends with it."""
        self._aborted = True
        self._process.abort()

    def close(self) -> None:
        """End the process."""
        self._process.close()


class _ReadFunction:
    """The process's function: created here; its reader is created on the first call there."""

    def __init__(self, options: Sequence[ImageOptions], limits: Limits) -> None:
        self._options = options
        self._limits = limits
        self._reader: SceneReader | None = None

    def __call__(self, questions: Questions) -> Answers:
        if self._reader is None:
            self._reader = SceneReader(self._options, self._limits)
        return self._reader.do(questions)


def _lost_record(questions: Questions, error: ProcessLostError) -> Answers:
    verdict = WorkerCrashedError(
        "the process that read the scene ended, twice",
        found=error.found,
        expected="a record of the scene",
        next_step="run the same command again, with fewer --workers where memory is short",
    )
    return [(asked.run, failed_record(asked.image, verdict)) for asked in questions]
