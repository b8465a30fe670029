"""`legoworld readout`: read a track of scenes into a run folder."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import IO

from legoworld import __version__
from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import UsageError
from legoworld.files import as_unicode, canonical_json, sha256_of_text
from legoworld.pluralize import share, word_for
from legoworld.readouts.protocol import readout_of
from legoworld.records.base import UNSET
from legoworld.records.folders import run_folder
from legoworld.records.folders.run_journal import (
    JournalledImage,
    UnwritableRecordError,
    append,
    journal,
)
from legoworld.records.folders.run_reading import CONFIGURATION, RUN_SCHEMA
from legoworld.records.run_file import (
    Configuration,
    ImageRecord,
    RunCoverage,
    RunFile,
    RunSummary,
    Shard,
    WholeRun,
)
from legoworld.records.run_rows import RunRow
from legoworld.running.disk import check_disk
from legoworld.running.image import SceneReader, arrived, lost_record, still_valid
from legoworld.running.image_record import ROW_SCHEMA, ImageOptions, verdict_instead
from legoworld.running.reader_process import ReaderProcess, worth_processes
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import bpy_version
from legoworld.scene.snapshot import SNAPSHOT_SCHEMA
from legoworld.tasks.registry import task_named
from legoworld.tracks.track import Track, TrackImage
from legoworld.visibility.library import library
from legoworld.workers.engines import ENGINES, EngineName, Job, Worker
from legoworld.workers.processors import usable_cores


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """All parameters of a readout run.

    engine, workers, limits and started never change its results. shard: (i, n), 1 <= i <= n: only
    every n-th image, from the i-th on. images_per_file: None for one file of predictions. started:
    a Blender process that was started ahead with these limits; the caller closes it, too.
    """

    image_options: ImageOptions
    track: Track
    engine: EngineName
    workers: int
    limits: Limits
    overwrite: bool
    limit: int | None
    image_ids: tuple[int, ...]
    shard: tuple[int, int] | None
    fail_fast: bool
    images_per_file: int | None
    started: BlenderProcess | None = None

    @property
    def partial(self) -> bool:
        """Whether only some of the track's images are requested, apart from sharding."""
        return self.limit is not None or bool(self.image_ids)


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """The results of a run."""

    rows: tuple[RunRow, ...]
    summary: RunSummary


Progress = Callable[[RunRow], None]


def run_readout(
    request: RunRequest,
    *,
    progress: Progress,
    notice: Callable[[str], None],
    kept: Callable[[int], None] = lambda _n: None,
    trace: Callable[[str], None] = lambda _text: None,
) -> RunResult:
    """Read out every requested image without a valid result, then write the run.

    progress: called with every new row; kept: called once with the number of kept images; trace:
    called with the traceback of every unexpected error.

    Raises UsageError, ConfigurationMismatchError, OutputFullError or KernelBuildError before
    anything is read; a scene that cannot be read is a row of the run, never an exception.
    """
    library()  # a broken installation is not the scene's fault
    folder = request.image_options.run
    images = shard_images(request)
    configuration = _configuration(request, images)
    with run_folder.locked(folder):
        unfinished = not request.overwrite and (folder / CONFIGURATION).is_file()
        damage = None if request.overwrite else run_folder.damage_notice(folder)
        earlier = run_folder.prepare(folder, configuration, overwrite=request.overwrite)
        if damage:
            notice(damage)
        by_id = {record.row.image_id: record for record in earlier}
        valid = {
            image.id: by_id[image.id]
            for image in images
            if image.id in by_id and still_valid(by_id[image.id], image, request.image_options)
        }
        todo = [image for image in images if image.id not in valid]
        kept(len(valid))
        if unfinished:
            notice("the last run into this folder ended before it was finished; it is resumed")
        if valid:
            read = share(len(valid), len(images), "image", "images")
            notice(f"{read} {word_for(len(valid), 'has', 'have')} a valid result already")
        _check_disk(request, todo, notice)
        del earlier, by_id  # predictions are many: from here on they are on disk only
        with journal(folder) as stream:
            records = {i: append(stream, record) for i, record in valid.items()}
            valid.clear()
            for record in _read_all(request, todo):
                if record.trace:
                    trace(f"{record.row.file_name}: {record.trace}".rstrip())
                stored = _appended(stream, record)
                records[stored.row.image_id] = stored
                progress(stored.row)
        rows = [records[image.id].row for image in images if image.id in records]
        summary = summarise(configuration, rows)
        run_folder.finish(
            folder,
            records=records.values(),
            run=run_document(configuration),
            summary=summary,
            with_predictions=request.image_options.protocol.readout.exports is not None,
        )
    return RunResult(rows=tuple(rows), summary=summary)


def _appended(stream: IO[bytes], record: ImageRecord) -> JournalledImage:
    """The record as stored; a failure in its place if it cannot be stored."""
    try:
        return append(stream, record)
    except UnwritableRecordError as error:
        return append(stream, verdict_instead(record, error))


def selected_images(request: RunRequest) -> list[TrackImage]:
    """The images to attempt: all of the track's, or those selected by --image-id and --limit."""
    images = list(request.track.images)
    if request.image_ids:
        known = {image.id for image in images}
        unknown = [i for i in request.image_ids if i not in known]
        if unknown:
            raise UsageError(
                "the track has no such image",
                found=f"--image-id {unknown[0]}",
                expected=f"one of {len(known)} ids, such as {min(known)}",
            )
        images = [image for image in images if image.id in request.image_ids]
    return images[: request.limit] if request.limit is not None else images


def shard_images(request: RunRequest) -> list[TrackImage]:
    """The images of this run: in a shard i/n, every n-th of the selected ones."""
    images = selected_images(request)
    if request.shard is None:
        return images
    index, of = request.shard
    return images[index - 1 :: of]


def summarise(configuration: Configuration, rows: Sequence[RunRow]) -> RunSummary:
    """summary.json: coverage by status, exports, and labels without effect.

    RunDamagedError for rows of an earlier run that are not what a run writes.
    """
    ok = [row for row in rows if row.status == "ok"]
    summary = RunSummary(
        schema_version=SCHEMA_VERSION,
        task=configuration.task,
        partial=bool(configuration.partial) or len(rows) < configuration.attempted,
        coverage=RunCoverage(
            attempted=configuration.attempted,
            ok=len(ok),
            by_status=dict(Counter(row.status for row in rows)),
        ),
        warnings=sum(len(row.warnings) for row in rows),
    )
    return readout_of(task_named(configuration.task)).sum_up(summary, rows, ok)


def _read_all(request: RunRequest, todo: list[TrackImage]) -> Iterator[ImageRecord]:
    """Records in order of completion; worker processes end with this generator."""
    workers = max(1, min(request.workers, len(todo)))
    cores = usable_cores()
    threads = max(1, cores // workers) if request.engine == "local" else 1
    options = replace(request.image_options, threads=threads)
    apart = request.engine == "local" and worth_processes(workers, len(todo), cores)
    make: Callable[[], Worker[TrackImage, ImageRecord]]
    if apart or request.engine != "local":
        make = partial(ReaderProcess if apart else SceneReader, options, request.limits)
    else:
        started = [request.started] if request.started is not None else []
        make = partial(SceneReader, options, request.limits, started)
    job = Job(make=make, lost=lost_record)
    with closing(ENGINES[request.engine](job, todo, workers)) as records:
        for record in records:
            yield arrived(record, options)
            if request.fail_fast and record.row.status != "ok":
                return


def _configuration(request: RunRequest, images: list[TrackImage]) -> Configuration:
    """Everything a run's results depend on, except the scenes; must be equal to resume."""
    options = request.image_options
    protocol = options.protocol
    selected = selected_images(request)
    described = [[i.id, as_unicode(i.file_name), i.size_wh] for i in selected]
    return Configuration(
        schema_version=SCHEMA_VERSION,
        kind="scene",
        task=protocol.task.name,
        card_version=protocol.card.version,
        card_sha256=protocol.card.sha256,
        vocabulary_sha256=protocol.vocabulary.sha256 if protocol.vocabulary else None,
        track_sha256=request.track.sha256,
        images_sha256=sha256_of_text(canonical_json(described)),
        attempted=len(images),
        partial=request.partial or request.shard is not None,
        shard=_shard_entry(request, len(selected)),
        source=options.source,
        require_frozen=options.require_frozen,
        max_side=options.max_side,
        legoworld=__version__,
        bpy=bpy_version(),
        snapshot_schema=SNAPSHOT_SCHEMA,
        row_schema=ROW_SCHEMA,
        images_per_file=request.images_per_file or UNSET,
        bench=options.bench.recorded() if options.bench else UNSET,
    )


def _shard_entry(request: RunRequest, n_selected: int) -> Shard | None:
    """The data from which `merge` restores the whole run's configuration."""
    if request.shard is None:
        return None
    whole = WholeRun(attempted=n_selected, partial=request.partial)
    return Shard(index=request.shard[0], of=request.shard[1], whole=whole)


def run_document(configuration: Configuration) -> RunFile:
    """run.json without its scenes: the one file that holds a time."""
    import numpy as np

    return RunFile(
        schema_version=RUN_SCHEMA,
        finished_at=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        configuration=configuration,
        versions={
            "legoworld": __version__,
            "bpy": bpy_version(),
            "numpy": np.__version__,
            "python": sys.version.split()[0],
        },
    )


def _check_disk(request: RunRequest, todo: list[TrackImage], notice: Callable[[str], None]) -> None:
    options = request.image_options
    file_bytes = options.protocol.readout.file_bytes
    if file_bytes is None:
        return
    sizes = [options.rendered_size(i.size_wh) for i in todo if i.size_wh is not None]
    check_disk(
        options.run,
        [file_bytes(size) for size in sizes],
        notice,
        what=options.protocol.card.reads,
        next_step="free some space, choose another -o, or render smaller with --max-side",
    )
