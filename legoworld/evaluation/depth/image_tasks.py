"""The images of a depth run, scored by the workers of a pool."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld import exit_codes
from legoworld.cards import load_card
from legoworld.errors import LegoWorldError
from legoworld.evaluation.checks import refuse_unseen
from legoworld.evaluation.depth.predictions import DepthImage, DepthRun
from legoworld.evaluation.depth.protocol import depth_protocol
from legoworld.evaluation.depth.rows import ImageResult, score_row
from legoworld.evaluation.depth.truth import TruthFile
from legoworld.workers.tasks import WorkerPool, results_of

#: Bytes of ground truth that are scored in the time that other processes take to start.
_FEW_BYTES: Final = 16 << 20


class DepthUnseenError(LegoWorldError):
    """A machine of the cluster does not see the same files as the command."""

    code = "depth_unseen"
    exit_code = exit_codes.BLOCKED


@dataclass(frozen=True, kw_only=True)
class ImageTask:
    """One image to score. task: its name; sizes_bytes: of its files as the command sees them."""

    task: str
    image: DepthImage
    file: TruthFile
    warped: bool
    sizes_bytes: dict[Path, int]


def image_tasks(run: DepthRun, files: Sequence[TruthFile], *, warped: bool) -> list[ImageTask]:
    """The task of each image of a run. warped: through the dataset's camera."""
    return [
        ImageTask(
            task=run.run.task,
            image=image,
            file=file,
            warped=warped,
            sizes_bytes={p: p.stat().st_size for p in (image.path, file.path) if p.is_file()},
        )
        for image, file in zip(run.images, files, strict=True)
    ]


def scored_images(tasks: Sequence[ImageTask], pool: WorkerPool) -> Iterator[ImageResult]:
    """The result of every image, in the order of the tasks."""
    truth_bytes = sum(task.sizes_bytes.get(task.file.path, 0) for task in tasks)
    much = len(tasks) > 1 and truth_bytes > _FEW_BYTES
    return results_of(score_task, tasks, pool.for_work(worth_a_process=much))


def score_task(task: ImageTask) -> ImageResult:
    """Score one image. DepthUnseenError if this machine does not see the command's files.

    Otherwise a file missing on this machine would be mistaken for a missing prediction.
    """
    what = f"the depth files of {task.image.image.file_name}"
    refuse_unseen(task.sizes_bytes, what, DepthUnseenError)
    camera = task.file.camera if task.warped else None
    return score_row(task.image, task.file, camera, depth_protocol(load_card(task.task)))
