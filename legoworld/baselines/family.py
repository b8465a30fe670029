"""The baselines of a family: whose answers become a run, and how."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from legoworld.errors import UsageError
from legoworld.records.run_file import RunSummary
from legoworld.records.run_rows import RunRow
from legoworld.running.readout_run import Progress, RunResult
from legoworld.tasks.registry import find_family

if TYPE_CHECKING:
    from legoworld.baselines.baseline_import import ImportRequest
    from legoworld.baselines.box_formats import BoxFormat
    from legoworld.baselines.category_ids import CategoryIds
    from legoworld.baselines.records import AnswerRules
    from legoworld.records.baseline_messages import Message
    from legoworld.records.run_file import ImageRecord, ImageSource
    from legoworld.tracks.track import TrackImage


@dataclass(frozen=True, kw_only=True)
class ImportListener:
    """What an import says while it works. total: how many images; progress: of each row."""

    total: Callable[[int], None]
    progress: Progress
    notice: Callable[[str], None]


class ImportOptions(TypedDict, total=False):
    """What is declared of imported results, as far as it is; each family takes some of it."""

    box_format: BoxFormat
    category_ids: CategoryIds
    label_map: Path
    subset: bool
    space: str
    unit: str
    sign: str
    array: str
    suffix: str
    intrinsics: Path


@dataclass(frozen=True, kw_only=True)
class BaselineFamily:
    """How answers of others become a run.

    of_folder: whether an import takes a folder and no single file; what: what that is, in words.
    options: those an import takes. import_answers: from the source and its options. sum_up: a run's
    summary of its rows that have a result. own_file: the file that a row without a result may have
    left, from the run folder; None where answers are no files. answered: a process's answer to an
    image as its record, LegoWorldError for an unusable one; None where no process answers.
    """

    of_folder: bool
    what: str
    options: frozenset[str]
    import_answers: Callable[[ImportRequest, Path, ImportOptions, ImportListener], RunResult]
    sum_up: Callable[[RunSummary, Sequence[RunRow]], RunSummary] = lambda summary, _ok: summary
    own_file: Callable[[RunRow], str] | None = None
    answered: Callable[[TrackImage, Message, AnswerRules, ImageSource], ImageRecord] | None = None


def load_baseline_family(task: str) -> BaselineFamily:
    """The baselines of a task. UsageError where there are none."""
    family = find_family(task)
    if family.baseline is None:
        raise UsageError(f"no baseline answers {task}", found=f"--task {task}")
    return family.load("baseline", BaselineFamily)
