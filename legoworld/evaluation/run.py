"""Reading finished run folders, whose images are the denominator of every number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeVar

from legoworld.errors import LegoWorldError, UsageError, cause
from legoworld.pluralize import plural
from legoworld.records.base import RecordError, decode, decode_lines
from legoworld.records.evaluation import Coverage, EvaluationRow
from legoworld.records.folders.prediction_files import prediction_files, stored_batches
from legoworld.records.folders.read_run import ROWS, RUN, describe_other_folder, list_altered
from legoworld.records.folders.run_journal import JOURNAL
from legoworld.records.predictions import Scored
from legoworld.records.run_file import Configuration, RunHead
from legoworld.records.run_rows import RunImage, RunRow
from legoworld.tasks.registry import family_tasks
from legoworld.tasks.task import Family

P = TypeVar("P", bound=Scored)
_EXPECTED: Final = f"{RUN} and {ROWS} as a run writes them; make a run with readout"


class RunUnusableError(LegoWorldError):
    """A run folder cannot be scored."""

    code = "run_unusable"


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run. images: ascending id; head: of run.json."""

    folder: Path
    head: RunHead
    images: tuple[RunImage, ...]

    @property
    def configuration(self) -> Configuration:
        """What the run was made with."""
        return self.head.configuration

    @property
    def task(self) -> str:
        """The task's name."""
        return self.configuration.task

    @property
    def partial(self) -> bool:
        """Whether the run attempted only some of its track's images."""
        return bool(self.configuration.partial)

    @property
    def inputs(self) -> list[tuple[str, Path]]:
        """Role and path of every file that a score is computed from, but files of rows."""
        return [
            ("run", self.folder / RUN),
            ("per_image", self.folder / ROWS),
            *(("predictions", path) for path in self.prediction_files),
        ]

    @property
    def prediction_files(self) -> list[Path]:
        """The files of a run of results, in the order of its images."""
        per_file = self.configuration.images_per_file or None
        return prediction_files(self.folder, per_file, len(self.images))

    def absolute(self) -> Run:
        """The run by its folder's whole path."""
        return replace(self, folder=self.folder.absolute())


def read_run(folder: Path) -> Run:
    """The run in a folder. RunUnusableError when it is absent, unfinished or inconsistent."""
    try:
        head = decode(RunHead, (folder / RUN).read_bytes())
    except (OSError, RecordError) as error:
        if other := describe_other_folder(folder, "a run"):
            raise RunUnusableError(other, found=f"no {RUN}", expected=_EXPECTED) from error
        raise _unreadable(folder, RUN, error) from error
    if (folder / JOURNAL).exists():
        raise RunUnusableError(
            f"the run in {folder.name} is unfinished",
            found=f"{JOURNAL} is still there",
            expected="a finished run",
            next_step="run its command again to resume",
        )
    _refuse_altered(folder, head, [folder / ROWS])
    try:
        images = decode_lines(RunImage, (folder / ROWS).read_bytes())
    except (OSError, RecordError) as error:
        raise _unreadable(folder, ROWS, error) from error
    n, attempted = len({i.image_id for i in images}), head.configuration.attempted
    if n != len(images) or n != attempted or not n:
        raise RunUnusableError(
            f"the run in {folder.name} does not cover its own track",
            found=f"rows: {len(images)}, of different images: {n}",
            expected=f"{plural(attempted, 'image', 'images')}, one row each",
            next_step="run its command again",
        )
    ordered = sorted(images, key=lambda i: i.image_id)
    return Run(folder=folder, head=head, images=tuple(ordered))


def read_family_run(folder: Path, family: Family, kind: str) -> Run:
    """A run of a family's tasks, `read_run`; UsageError for another. kind: "a depth run"."""
    run = read_run(folder)
    names = [task.name for task in family_tasks(family)]
    if run.task not in names:
        raise UsageError(
            f"{folder.name or folder} is not {kind}",
            found=f"task {run.task!r}",
            expected=f"a run of the task {' or '.join(map(repr, names))}",
        )
    return run


def count_images(rows: Sequence[EvaluationRow]) -> Coverage:
    """Images by outcome: the denominators of every number."""
    return Coverage(
        attempted=len(rows),
        scored=sum(row.has_score for row in rows),
        with_truth=sum(row.has_truth for row in rows),
        by_status=dict(sorted(Counter(row.status for row in rows).items())),
    )


def read_rows(run: Run) -> list[RunRow]:
    """The run's rows in full, ascending id. RunUnusableError."""
    try:
        rows = decode_lines(RunRow, (run.folder / ROWS).read_bytes())
    except (OSError, RecordError) as error:
        raise _unreadable(run.folder, ROWS, error) from error
    return sorted(rows, key=lambda row: row.image_id)


def _refuse_altered(folder: Path, head: RunHead, files: list[Path]) -> None:
    """Raise RunUnusableError if a file was altered after the run."""
    for name in list_altered(folder, head, files):
        raise RunUnusableError(
            f"{folder.name}/{name} is not the one that the run wrote",
            found="another sha256",
            expected=f"the sha256 in {RUN}",
            next_step="run its command again; altered rows need --overwrite",
        )


def read_predictions(run: Run, kind: type[P]) -> Iterator[list[P]]:
    """Every prediction of the run, as a kind of prediction, some MiB at a time.

    PredictionsUnreadableError names a file that is absent or damaged, RunUnusableError one that is
    not as the run wrote it.
    """
    _refuse_altered(run.folder, run.head, run.prediction_files)
    yield from stored_batches(run.prediction_files, kind)


def run_view(run: Run) -> dict[str, Any]:
    """view/run.json: run.json without its time, and the rows, as they are in their files.

    Into how many files the predictions are divided is left out: no number depends on it.
    """
    name = RUN
    try:
        document = decode(dict[str, Any], (run.folder / RUN).read_bytes())
        name = ROWS
        rows = decode_lines(dict[str, Any], (run.folder / ROWS).read_bytes())
    except (OSError, RecordError) as error:
        raise _unreadable(run.folder, name, error) from error
    document["configuration"].pop("images_per_file", None)
    return {
        **{key: document.get(key) for key in ("configuration", "versions", "scenes", "baseline")},
        "images": sorted(rows, key=lambda row: int(row["image_id"])),
    }


def _unreadable(folder: Path, name: str, error: OSError | RecordError) -> RunUnusableError:
    return RunUnusableError(
        f"{folder}/{name} cannot be read", found=cause(error), expected=_EXPECTED
    )
