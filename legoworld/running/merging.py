"""`legoworld merge`: the shards of one run, put together as if it had never been divided."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from legoworld.errors import ConfigurationMismatchError, UsageError
from legoworld.files import atomic_path
from legoworld.readouts.tasks import TASKS
from legoworld.records.folders import run_folder
from legoworld.records.folders.prediction_files import IMAGES_PER_FILE, with_division
from legoworld.records.folders.row_files import files_of
from legoworld.records.folders.run_folder import Record
from legoworld.records.repeats import repeated
from legoworld.running.readout_run import RunResult, run_document, summarise

#: What one shard's configuration holds that another's of the same run does not.
_OWN = ("attempted", "partial", "shard", IMAGES_PER_FILE)


def merge_shards(
    shards: Sequence[Path], output: Path, *, images_per_file: int | None, overwrite: bool
) -> RunResult:
    """Write the run that the shards 1/n .. n/n make up: byte for byte the undivided run's.

    One undivided run alone, a baseline's too, is written again as it is. images_per_file: how its
    predictions are divided into files; None for one file.

    Raises ConfigurationMismatchError naming what differs between two shards, and UsageError when
    a folder is no shard, one is missing or given twice, or has lost predictions.
    """
    documents = [_finished_document(folder) for folder in shards]
    configurations = [document["configuration"] for document in documents]
    alone = len(shards) == 1 and not configurations[0].get("shard")
    whole = configurations[0] if alone else _whole(list(shards), configurations)
    configuration = with_division(whole, images_per_file)
    with_predictions = TASKS[configuration["task"]].predict is not None
    _refuse_division(images_per_file, with_predictions=with_predictions)
    _refuse_own_output(shards, output)
    with run_folder.locked(output):
        # Records of an earlier merge are not kept: the shards may have been run again since.
        run_folder.begin(output, configuration, overwrite=overwrite)
        (output / run_folder.JOURNAL).unlink(missing_ok=True)
        records = _brought_together(shards, output)
        rows = [record["row"] for record in records]
        summary = _summary_of(shards[0], documents[0]) if alone else summarise(configuration, rows)
        document = documents[0] if alone else run_document(configuration)
        run_folder.finish(
            output,
            records=records,
            run={**document, "configuration": configuration},
            summary=summary,
            with_predictions=with_predictions,
        )
    return RunResult(rows=tuple(rows), summary=summary)


def _brought_together(shards: Sequence[Path], output: Path) -> list[Record]:
    """Every record by ascending image id, its predictions in the journal of the output."""
    records = []
    with run_folder.journal(output) as journal:
        for folder in shards:
            for record in run_folder.finished_records(folder):
                _refuse_losses(folder, record)
                _take_files(folder, output, record["row"])
                records.append(run_folder.append(journal, record))
    return sorted(records, key=lambda record: int(record["row"]["image_id"]))


def _refuse_division(images_per_file: int | None, *, with_predictions: bool) -> None:
    if images_per_file is not None and not with_predictions:
        raise UsageError(
            "only boxes and masks are divided into files",
            found=f"--images-per-file {images_per_file} where each image has its own files already",
            expected="no --images-per-file",
        )


def _refuse_own_output(shards: Sequence[Path], output: Path) -> None:
    """A run that is read must not be begun anew."""
    for folder in shards:
        if folder.resolve() == output.resolve():
            raise UsageError(
                f"-o {output.name} is one of the runs that are read",
                found="the same folder",
                expected="another one",
                next_step="choose another -o",
            )


def _refuse_losses(folder: Path, record: Record) -> None:
    row, found = record["row"], len(record["predictions"])
    expected = row.get("n_predictions", 0)
    if found != expected:
        raise UsageError(
            f"{folder.name} has not all of its predictions",
            found=f"{found} of image {row['image_id']}",
            expected=f"{expected}, as its row says",
            next_step="run its command again: what is lost is read again",
        )


def _summary_of(folder: Path, document: dict[str, Any]) -> dict[str, Any]:
    try:
        text = (folder / run_folder.SUMMARY).read_text(encoding="utf-8")
        summary: dict[str, Any] = json.loads(text)
        run_folder.refuse_altered(folder, document, [folder / run_folder.SUMMARY])
        if any(type(summary["coverage"][key]) is not int for key in ("ok", "attempted")):
            raise TypeError("no coverage in it")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise run_folder.RunDamagedError(
            f"{folder.name}/{run_folder.SUMMARY} cannot be read",
            found=getattr(error, "strerror", None) or str(error),
            expected="what a finished run writes",
            next_step="run its command again with --overwrite",
        ) from error
    return summary


def _finished_document(folder: Path) -> dict[str, Any]:
    """run.json of a run that has ended, without its scenes."""
    try:
        document = json.loads((folder / run_folder.RUN).read_text(encoding="utf-8"))
        task = document["configuration"]["task"]
        if (folder / run_folder.JOURNAL).exists():
            raise ValueError("it has not ended")
        if task not in TASKS:
            raise ValueError(f"task {task!r}")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise UsageError(
            f"{folder.name} is not a finished shard",
            found=getattr(error, "strerror", None) or str(error),
            expected="the output of `legoworld readout --shard i/n`, or one undivided run alone",
            next_step="run its command again: it goes on where it stopped",
        ) from error
    return {key: value for key, value in document.items() if key != "scenes"}


def _whole(folders: list[Path], configurations: list[dict[str, Any]]) -> dict[str, Any]:
    """The configuration of the undivided run; refuses shards that do not make one up."""
    for folder, configuration in zip(folders, configurations, strict=True):
        if not configuration.get("shard"):
            raise UsageError(
                f"{folder.name} is not a shard",
                found="a run of its whole track",
                expected="outputs of `legoworld readout --shard i/n`, or one undivided run alone",
            )
    first = configurations[0]
    for folder, other in zip(folders[1:], configurations[1:], strict=True):
        changed = sorted(
            key for key in {*first, *other} - {*_OWN} if first.get(key) != other.get(key)
        )
        if changed or first["shard"]["of"] != other["shard"]["of"]:
            raise ConfigurationMismatchError(
                f"{folders[0].name} and {folder.name} are shards of different runs",
                found=f"different {', '.join(changed) or 'numbers of shards'}",
                expected="shards of one track, read with the same options and versions",
                next_step="run the odd one again",
            )
    of = first["shard"]["of"]
    indices = sorted(c["shard"]["index"] for c in configurations)
    if indices != list(range(1, of + 1)):
        missing = sorted({*range(1, of + 1)} - {*indices})
        twice = repeated(indices)
        raise UsageError(
            "the shards do not make up the run",
            found="; ".join(
                f"{what}: {', '.join(f'{i}/{of}' for i in some[:10])}"
                for what, some in (("missing", missing), ("given twice", twice))
                if some
            ),
            expected=f"each of 1/{of} to {of}/{of} once",
            next_step="run the missing ones, then merge again",
        )
    return {**first, **first["shard"]["whole"], "shard": None}


def _take_files(shard: Path, output: Path, row: dict[str, Any]) -> None:
    """Bring a row's own files over: linked where one disk holds both, copied otherwise."""
    for file in files_of(row):
        source, target = shard / file["file"], output / file["file"]
        target.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(target) as temporary:
            try:
                os.link(source, temporary)
            except OSError:
                shutil.copyfile(source, temporary)
