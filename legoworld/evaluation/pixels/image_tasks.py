"""The images of a run, scored by the workers of a pool."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.evaluation.checks import refuse_unseen
from legoworld.evaluation.pixels.family import ImageResult, Options, PixelFamily, TruthFile
from legoworld.evaluation.pixels.predictions import PixelImage, PixelRun
from legoworld.evaluation.pixels.rows import score_row
from legoworld.workers.tasks import WorkerPool, map_items

#: Bytes of ground truth that are scored in the time that other processes take to start.
_FEW_BYTES: Final = 16 << 20


@dataclass(frozen=True, kw_only=True)
class ImageTask:
    """One image to score. task: its name; sizes_bytes: of its files as the command sees them."""

    family: PixelFamily
    task: str
    image: PixelImage
    file: TruthFile
    options: Options
    sizes_bytes: dict[Path, int]


def image_tasks(
    run: PixelRun, files: Sequence[TruthFile], family: PixelFamily, options: Options
) -> list[ImageTask]:
    """The task of each image of a run."""
    return [
        ImageTask(
            family=family,
            task=run.run.task,
            image=image,
            file=file,
            options=options,
            sizes_bytes={p: p.stat().st_size for p in (image.path, file.path) if p.is_file()},
        )
        for image, file in zip(run.images, files, strict=True)
    ]


def scored_images(tasks: Sequence[ImageTask], pool: WorkerPool) -> Iterator[ImageResult]:
    """The result of every image, in the order of the tasks."""
    truth_bytes = sum(task.sizes_bytes.get(task.file.path, 0) for task in tasks)
    much = len(tasks) > 1 and truth_bytes > _FEW_BYTES
    return map_items(score_task, tasks, pool.for_work(worth_a_process=much))


def score_task(task: ImageTask) -> ImageResult:
    """Score one image. The family's `unseen` if this machine does not see the command's files.

    Otherwise a file missing on this machine would be mistaken for a missing prediction.
    """
    what = f"the {task.family.noun} files of {task.image.image.file_name}"
    refuse_unseen(task.sizes_bytes, what, task.family.errors.unseen)
    return score_row(task.image, task.file, task.family, task.task, task.options)
