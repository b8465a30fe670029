"""`legoworld merge`: join the shards of a run as if it had never been divided."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.errors import ConfigurationMismatchError, UsageError, cause
from legoworld.files import atomic_path
from legoworld.readouts.family import load_readout_family
from legoworld.records.base import RecordError, as_json, decode, find_repeated
from legoworld.records.folders import run_folder
from legoworld.records.folders.read_run import (
    RUN,
    SUMMARY,
    damaged_error,
    describe_other_folder,
    finished_records,
    refuse_altered,
)
from legoworld.records.folders.run_journal import JOURNAL, JournalledImage, append, journal
from legoworld.records.run_file import Configuration, ImageRecord, RunFile, RunSummary, Shard
from legoworld.records.run_rows import RunRow
from legoworld.running.readout_run import RunResult, run_document, summarise
from legoworld.tasks.registry import find_task, require_task

#: The keys in which the configurations of two shards of one run differ.
_OWN: Final = ("attempted", "partial", "shard", "images_per_file")


def merge_shards(
    shards: Sequence[Path], output: Path, *, images_per_file: int | None, overwrite: bool
) -> RunResult:
    """Write the run that consists of the shards 1/n to n/n: byte for byte the undivided run's.

    A single undivided run, of a baseline too, is rewritten. images_per_file: how its predictions
    are divided into files; None for one file.

    Raises ConfigurationMismatchError naming the differences between two shards, and UsageError if a
    folder is not a shard, a shard is missing or repeated, or has lost predictions.
    """
    documents = [_finished_document(folder) for folder in shards]
    configurations = [document.configuration for document in documents]
    alone = len(shards) == 1 and not configurations[0].shard
    whole = configurations[0] if alone else _undivided_configuration(list(shards), configurations)
    configuration = run_folder.divide_configuration(whole, images_per_file)
    readout = load_readout_family(require_task(configuration.task))
    with_predictions = readout.exports is not None
    _refuse_division(images_per_file, with_predictions=with_predictions)
    _refuse_own_output(shards, output)
    with run_folder.lock_run(output):
        # Records of an earlier merge are not kept: the shards may have been run again since.
        run_folder.delete_leftovers(output)
        run_folder.begin(output, configuration, overwrite=overwrite)
        (output / JOURNAL).unlink(missing_ok=True)
        records = _collect_files(shards, output)
        rows = [record.row for record in records]
        summary = _summarise(shards[0], documents[0]) if alone else summarise(configuration, rows)
        document = documents[0] if alone else run_document(configuration)
        run_folder.finish(
            output,
            records=records,
            run=replace(document, configuration=configuration),
            summary=summary,
            with_predictions=with_predictions,
            complete=readout.complete,
        )
    return RunResult(rows=tuple(rows), summary=summary)


def _collect_files(shards: Sequence[Path], output: Path) -> list[JournalledImage]:
    """All records by ascending image id, with their predictions in the output's journal."""
    records = []
    with journal(output) as stream:
        for folder in shards:
            for record in finished_records(folder):
                _refuse_losses(folder, record)
                _take_files(folder, output, record.row)
                records.append(append(stream, record))
    return sorted(records, key=lambda record: record.row.image_id)


def _refuse_division(images_per_file: int | None, *, with_predictions: bool) -> None:
    if images_per_file is not None and not with_predictions:
        raise UsageError(
            "only boxes and masks can be divided into files",
            found=f"--images-per-file {images_per_file} where each image has its own files already",
            expected="no --images-per-file",
        )


def _refuse_own_output(shards: Sequence[Path], output: Path) -> None:
    """Refuse an output that is one of the inputs."""
    for folder in shards:
        if folder.resolve() == output.resolve():
            raise UsageError(
                f"-o {output.name} is one of the input runs",
                found="the same folder",
                expected="another one",
                next_step="choose another -o",
            )


def _refuse_losses(folder: Path, record: ImageRecord) -> None:
    found, expected = len(record.predictions), record.row.n_predictions or 0
    if found != expected:
        raise UsageError(
            f"{folder.name} lacks some of its predictions",
            found=f"{found} of image {record.row.image_id}",
            expected=f"{expected}, as its row says",
            next_step="run its command again: what is lost is read again",
        )


def _summarise(folder: Path, document: RunFile) -> RunSummary:
    try:
        summary = decode(RunSummary, (folder / SUMMARY).read_bytes())
    except (OSError, RecordError) as error:
        raise damaged_error(folder, SUMMARY, error) from error
    refuse_altered(folder, document, [folder / SUMMARY])
    return summary


def _finished_document(folder: Path) -> RunFile:
    """run.json of a run that has ended."""
    try:
        document = decode(RunFile, (folder / RUN).read_bytes())
        if (folder / JOURNAL).exists():
            raise RecordError("it has not ended")
        if find_task(document.configuration.task) is None:
            raise RecordError(f"task {document.configuration.task!r}")
    except (OSError, RecordError) as error:
        raise UsageError(
            describe_other_folder(folder, "a run") or f"{folder} is not a finished shard",
            found=cause(error),
            expected="the output of `legoworld readout --shard i/n`, or one undivided run alone",
            next_step="run its command again to resume",
        ) from error
    return document


def _undivided_configuration(
    folders: list[Path], configurations: list[Configuration]
) -> Configuration:
    """The configuration of the undivided run; refuses an incomplete set of shards."""
    shards = [_read_shard(f, c) for f, c in zip(folders, configurations, strict=True)]
    first, of = _shared_configuration(configurations[0]), shards[0].of
    for folder, other, shard in zip(folders[1:], configurations[1:], shards[1:], strict=True):
        theirs = _shared_configuration(other)
        changed = sorted(k for k in {*first, *theirs} if first.get(k) != theirs.get(k))
        if changed or of != shard.of:
            raise ConfigurationMismatchError(
                f"{folders[0].name} and {folder.name} are shards of different runs",
                found=f"different {', '.join(changed) or 'numbers of shards'}",
                expected="shards of one track, read with the same options and versions",
                next_step="run the odd one again",
            )
    _refuse_gaps(sorted(shard.index for shard in shards), of)
    whole = shards[0].whole
    return replace(configurations[0], attempted=whole.attempted, partial=whole.partial, shard=None)


def _read_shard(folder: Path, configuration: Configuration) -> Shard:
    if not configuration.shard:
        raise UsageError(
            f"{folder.name} is not a shard",
            found="a run of its whole track",
            expected="outputs of `legoworld readout --shard i/n`, or one undivided run alone",
        )
    return configuration.shard


def _shared_configuration(configuration: Configuration) -> Mapping[str, object]:
    """What must be the same in all shards of a run."""
    return {k: v for k, v in as_json(configuration).items() if k not in _OWN}


def _refuse_gaps(indices: list[int], of: int) -> None:
    if indices == list(range(1, of + 1)):
        return
    missing = sorted({*range(1, of + 1)} - {*indices})
    raise UsageError(
        "the shards are not a complete run",
        found="; ".join(
            f"{what}: {', '.join(f'{i}/{of}' for i in some[:10])}"
            for what, some in (("missing", missing), ("given twice", find_repeated(indices)))
            if some
        ),
        expected=f"each of 1/{of} to {of}/{of} once",
        next_step="run the missing ones, then merge again",
    )


def _take_files(shard: Path, output: Path, row: RunRow) -> None:
    """Transfer a row's files: hard-linked on the same disk, otherwise copied."""
    for file in row.files:
        source, target = shard / file.file, output / file.file
        target.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(target) as temporary:
            try:
                os.link(source, temporary)
            except OSError:
                shutil.copyfile(source, temporary)
