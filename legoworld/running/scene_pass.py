"""`legoworld readout`: one pass over frozen scenes for one or several runs.

Each scene folder is hashed, read and drawn once for all tasks that ask something of it; a run's
folder has the bytes that a pass for its task alone writes.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import IO

from legoworld import exit_codes
from legoworld.errors import LegoWorldError
from legoworld.pluralize import plural, share, word_for
from legoworld.records.folders import run_folder
from legoworld.records.folders.read_run import CONFIGURATION
from legoworld.records.folders.run_journal import (
    JournalledImage,
    UnwritableRecordError,
    append,
    journal,
)
from legoworld.records.run_file import ImageRecord
from legoworld.records.run_rows import RunRow
from legoworld.remote import PlaceError
from legoworld.running.image import (
    Answers,
    Question,
    Questions,
    SceneReader,
    at_hand,
    check_arrived,
    lost_records,
    still_valid,
)
from legoworld.running.image_record import verdict_instead
from legoworld.running.reader_process import ReaderProcess, worth_processes
from legoworld.running.readout_run import (
    RunRequest,
    RunResult,
    run_configuration,
    run_document,
    shard_images,
    summarise,
)
from legoworld.running.shared_scene import HashedScene
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.tracks.track import TrackImage
from legoworld.visibility.library import library
from legoworld.workers.engines import ENGINES, EngineName, Job, Worker
from legoworld.workers.processors import usable_cores


class OutputFullError(LegoWorldError):
    """The run's output does not fit on the disk."""

    code = "disk_full"
    exit_code = exit_codes.BLOCKED


def check_disk(
    folder: Path,
    file_bytes: Sequence[int],
    notice: Callable[[str], None],
    *,
    what: str,
    next_step: str,
    beside: int = 0,
) -> None:
    """Report the size of all files; OutputFullError if they do not fit.

    what: such as "depth"; beside: bytes that other runs of the same pass write.
    """
    expected = sum(file_bytes)
    free = shutil.disk_usage(folder).free
    notice(
        f"{what}: about {_megabytes(expected)} for "
        f"{plural(len(file_bytes), 'image', 'images')} of known size, "
        f"{_megabytes(free)} free"
    )
    if expected + beside > free:
        raise OutputFullError(
            f"the {what} files will not fit on the disk",
            found=f"{_megabytes(free)} free",
            expected=_megabytes(expected + beside),
            next_step=next_step,
        )


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.0f} MB"


Say = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class PassRequest:
    """Runs that share their scenes, source, cache and require_frozen, and how they are read.

    engine, workers, limits and started never change a result. started: a Blender process that was
    started ahead with these limits; the caller closes it, too.
    """

    runs: tuple[RunRequest, ...]
    engine: EngineName
    workers: int
    limits: Limits
    fail_fast: bool
    started: BlenderProcess | None = None


def read_scenes(
    request: PassRequest,
    *,
    progress: Callable[[RunRow], None],
    notice: Say,
    kept: Callable[[int], None] = lambda _n: None,
    trace: Say = lambda _text: None,
) -> list[RunResult]:
    """Read out every requested image without a valid result, then write the runs.

    progress: called with every new row; kept: called once with the number of kept images; trace:
    called with the traceback of every unexpected error.

    Raises UsageError, ConfigurationMismatchError, OutputFullError or KernelBuildError before
    anything is read; a scene that cannot be read is a row of each run, never an exception.
    """
    library()  # a broken installation is not the scene's fault
    several = len(request.runs) > 1
    with ExitStack() as locks:
        for one in request.runs:
            locks.enter_context(run_folder.lock_run(one.image_options.run))
        runs = []
        for one in request.runs:
            prefix = f"{one.image_options.protocol.task.name}: " if several else ""
            runs.append(_RunningRun(one, partial(_say_with_prefix, prefix, notice)))
        _keep_valid(runs)
        kept(sum(len(run.valid) for run in runs))
        sizes = [run.file_bytes() for run in runs]
        total = sum(sum(own) for own in sizes)
        for run, own in zip(runs, sizes, strict=True):
            run.check_disk(own, beside=total - sum(own))
        with ExitStack() as journals:
            for run in runs:
                run.open_journal(journals)
            for number, record in _read_all(request, runs, notice):
                if record.trace:
                    trace(f"{record.row.file_name}: {record.trace}".rstrip())
                progress(runs[number].store(record))
        return [run.finish() for run in runs]


def _say_with_prefix(prefix: str, notice: Say, text: str) -> None:
    notice(prefix + text)


class _RunningRun:
    """One run of a pass between its beginning and its end; its folder is locked.

    earlier: results of an earlier command; valid: those that still hold, until they are stored.
    """

    def __init__(self, request: RunRequest, notice: Say) -> None:
        self.request = request
        self.options = request.image_options
        self.images = shard_images(request)
        self.valid: dict[int, ImageRecord] = {}
        self._notice = notice
        self._configuration = run_configuration(request, self.images)
        self._records: dict[int, JournalledImage] = {}
        self._stream: IO[bytes] | None = None
        self.earlier = self._begin()

    def _begin(self) -> dict[int, ImageRecord]:
        folder, overwrite = self.options.run, self.request.overwrite
        unfinished = not overwrite and (folder / CONFIGURATION).is_file()
        damage = None if overwrite else run_folder.damage_notice(folder)
        earlier = run_folder.prepare(folder, self._configuration, overwrite=overwrite)
        if damage:
            self._notice(damage)
        if unfinished:
            self._notice(
                "the last run into this folder ended before it was finished; it is resumed"
            )
        return {one.row.image_id: one for one in earlier if one.row.status == "ok"}

    def say_kept(self) -> None:
        """Report how many images are not read again."""
        if self.valid:
            read = share(len(self.valid), len(self.images), "image", "images")
            have = word_for(len(self.valid), "has", "have")
            self._notice(f"{read} {have} a valid result already")

    def todo(self) -> list[TrackImage]:
        """The images to read."""
        done = self.valid or self._records
        return [image for image in self.images if image.id not in done]

    def file_bytes(self) -> list[int]:
        """Upper bounds of the files that are still to be written, of images of known size."""
        bound = self.options.protocol.readout.file_bytes
        if bound is None:
            return []
        return [bound(self.options.rendered_size(i.size_wh)) for i in self.todo() if i.size_wh]

    def check_disk(self, file_bytes: Sequence[int], *, beside: int) -> None:
        """OutputFullError if the files do not fit; beside: bytes of the pass's other runs."""
        if self.options.protocol.readout.file_bytes is not None:
            check_disk(
                self.options.run,
                file_bytes,
                self._notice,
                what=self.options.protocol.card.reads,
                next_step="free some space, choose another -o, or render smaller with --max-side",
                beside=beside,
            )

    def open_journal(self, journals: ExitStack) -> None:
        """Begin to store; the valid records first. Predictions are on disk only from here on."""
        self._stream = journals.enter_context(journal(self.options.run))
        for number, record in self.valid.items():
            self._records[number] = append(self._stream, record)
        self.valid, self.earlier = {}, {}

    def store(self, record: ImageRecord) -> RunRow:
        """Put a record on disk; a failure in its place if it cannot be stored. Its row."""
        assert self._stream is not None
        try:
            stored = append(self._stream, record)
        except UnwritableRecordError as error:
            stored = append(self._stream, verdict_instead(record, error))
        self._records[stored.row.image_id] = stored
        return stored.row

    def finish(self) -> RunResult:
        """Write the run's files; its journal is closed."""
        rows = [self._records[i.id].row for i in self.images if i.id in self._records]
        summary = summarise(self._configuration, rows)
        run_folder.finish(
            self.options.run,
            records=self._records.values(),
            run=run_document(self._configuration),
            summary=summary,
            with_predictions=self.options.protocol.readout.exports is not None,
            complete=self.options.protocol.readout.complete,
        )
        return RunResult(rows=tuple(rows), summary=summary)


def _keep_valid(runs: Sequence[_RunningRun]) -> None:
    """Keep the earlier records whose scenes are as they were; each scene is hashed once."""
    earlier = [[image for image in run.images if image.id in run.earlier] for run in runs]
    for questions in _by_scene(earlier):
        scene = questions[0].image.scene
        with suppress(PlaceError), at_hand(scene, [run.options for run in runs]) as options:
            hashed = HashedScene(scene, options[0])
            for one in questions:
                record = runs[one.run].earlier[one.image.id]
                if still_valid(record, hashed, options[one.run]):
                    runs[one.run].valid[one.image.id] = record
    for run in runs:
        run.say_kept()


def _by_scene(images: Sequence[Sequence[TrackImage]]) -> list[Questions]:
    """What is asked of each scene folder, from the images of each run; in order of appearance."""
    scenes: dict[str, list[Question]] = {}
    for run, of_run in enumerate(images):
        for image in of_run:
            scenes.setdefault(image.scene, []).append(Question(run=run, image=image))
    return [tuple(questions) for questions in scenes.values()]


def _read_all(
    request: PassRequest, runs: Sequence[_RunningRun], notice: Say
) -> Iterator[tuple[int, ImageRecord]]:
    """Records with their run's number, in order of completion; workers end with this generator.

    notice: of what large scenes take; other processes do not tell.
    """
    todo = _by_scene([run.todo() for run in runs])
    workers = max(1, min(request.workers, len(todo)))
    cores = usable_cores()
    threads = max(1, cores // workers) if request.engine == "local" else 1
    options = [replace(run.options, threads=threads) for run in runs]
    apart = request.engine == "local" and worth_processes(workers, len(todo), cores)
    make: Callable[[], Worker[Questions, Answers]]
    if apart or request.engine != "local":
        make = partial(ReaderProcess if apart else SceneReader, options, request.limits)
    else:
        started = [request.started] if request.started is not None else []
        make = partial(SceneReader, options, request.limits, started, notice)
    job = Job(make=make, lost_result=lost_records)
    with closing(ENGINES[request.engine](job, todo, workers)) as answers:
        for answer in answers:
            for number, record in answer:
                found = check_arrived(record, options[number])
                yield number, found
                if request.fail_fast and found.row.status != "ok":
                    return
