"""The run folder as it is written: one writer at a time, a journal, canonical files at the end."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from msgspec import structs

from legoworld.errors import ConfigurationMismatchError, UsageError
from legoworld.files import TEMPORARY_SUFFIX, Json, sync_file, sync_folder, write_text
from legoworld.locks import held_alone
from legoworld.records.base import UNSET, RecordError, canonical, decode, readable, short_json
from legoworld.records.folders.prediction_files import (
    FOLDER,
    PREDICTIONS,
    delete_predictions,
    present_files,
    write_predictions,
)
from legoworld.records.folders.read_run import (
    ANSWERS,
    CONFIGURATION,
    ROWS,
    RUN,
    RUN_SCHEMA,
    SUMMARY,
    RunDamagedError,
    finished_records,
    hashes,
    recorded_configuration,
)
from legoworld.records.folders.run_journal import (
    JOURNAL,
    JournalledImage,
    journal_records,
    predictions_at,
)
from legoworld.records.run_file import Configuration, ImageRecord, RunFile, RunSummary
from legoworld.records.run_rows import RunRow

#: The keys of a row that describe a file (`RunRow.files`); also their folders.
FOLDERS: Final = ("depth", "normals", "surface", "render", "answer")
_SUFFIXES: Final = (".npz", ".png", ".json")


_LOCK: Final = ".lock"
#: Begins the name of the folder in which a baseline's process writes, while it runs.
BASELINE_SCRATCH: Final = ".legoworld-baseline-"
_RESULTS: Final = (RUN, ROWS, SUMMARY, ANSWERS, JOURNAL)
#: All that a run writes into its folder, and what of it only a run has.
_OF_A_RUN: Final = {*_RESULTS, CONFIGURATION, _LOCK, PREDICTIONS, FOLDER, *FOLDERS}
_OF_A_RUN_ALONE: Final = {ROWS, JOURNAL, _LOCK}


@contextmanager
def lock_run(folder: Path) -> Iterator[None]:
    """Hold a run folder for this process alone. UsageError when another one has it."""
    refuse_strangers(folder)
    folder.mkdir(parents=True, exist_ok=True)
    refused = UsageError(
        "another process is writing into the run folder",
        found=f"{folder.name}/{_LOCK} is held",
        expected="one run per folder",
        next_step="wait for it, or choose another -o",
    )
    with held_alone(folder / _LOCK, refused):
        yield


def refuse_strangers(folder: Path) -> None:
    """ConfigurationMismatchError for a folder of something else than a run, left untouched."""
    if not folder.exists():
        return
    names = [p.name for p in folder.iterdir()]
    try:
        if recorded_configuration(folder) is not None:
            return
    except RunDamagedError:
        if _OF_A_RUN_ALONE & {*names} and all(map(_is_of_a_run, names)):
            return  # begun again with --overwrite; without it, it is refused when it is read
        raise
    strangers = sorted(name for name in names if not _is_of_a_beginning(name))
    if strangers:
        raise ConfigurationMismatchError(
            "the output folder holds something that is not a run",
            found=", ".join(strangers[:5]),
            expected="an empty folder or an earlier run",
            next_step="choose another -o",
        )


def _is_of_a_run(name: str) -> bool:
    unfinished = name.startswith(".") and name.endswith(TEMPORARY_SUFFIX)
    return name in _OF_A_RUN or unfinished or name.startswith(BASELINE_SCRATCH)


def _is_of_a_beginning(name: str) -> bool:
    """Whether a run that was killed before its configuration was on record left the file."""
    unfinished = name.startswith(f".{CONFIGURATION}.") and name.endswith(TEMPORARY_SUFFIX)
    return name == _LOCK or unfinished or name.startswith(BASELINE_SCRATCH)


def prepare(folder: Path, configuration: Configuration, *, overwrite: bool) -> list[ImageRecord]:
    """Make the folder ready for a run and return the records it already has.

    ConfigurationMismatchError names the keys that differ from an earlier run; with `overwrite`
    the earlier results are deleted.
    """
    records = earlier_records(folder, configuration, overwrite=overwrite)
    delete_leftovers(folder)
    begin(folder, configuration, overwrite=overwrite)
    return records


def earlier_records(
    folder: Path, configuration: Configuration, *, overwrite: bool, unknown: Sequence[str] = ()
) -> list[ImageRecord]:
    """The records the folder has for this configuration, before anything in it is changed.

    unknown: keys of the configuration that are known only when the work begins; `begin` compares
    them. ConfigurationMismatchError names the other keys that differ, unless `overwrite`.
    """
    earlier = None if overwrite else recorded_configuration(folder)
    if earlier is None:
        return []
    _refuse_changes(earlier, configuration, unknown)
    records, _ = journal_records(folder)
    return [*finished_records(folder), *records]


def damage_notice(folder: Path) -> str | None:
    """What to say of a journal with lines that cannot be used; None for a whole one."""
    _, damaged = journal_records(folder)
    if not damaged:
        return None
    return f"{JOURNAL} is damaged: what {damaged} of its lines held is done again"


def delete_leftovers(folder: Path) -> None:
    """Delete the unfinished files of a killed run, before anything writes to the folder again."""
    for parent, folders, files in os.walk(folder):
        # What a killed run's baseline wrote is its keeper's to remove, which may be at it.
        folders[:] = [name for name in folders if not name.startswith(BASELINE_SCRATCH)]
        for name in files:
            if name.startswith(".") and name.endswith(TEMPORARY_SUFFIX):
                Path(parent, name).unlink()


def begin(folder: Path, configuration: Configuration, *, overwrite: bool) -> None:
    """Put the configuration on record, after the same check; with `overwrite` results go first."""
    if overwrite:
        # Whenever this is interrupted, the folder is still known as a run's, and no result of the
        # earlier one can be taken for this one's.
        for name in (JOURNAL, ROWS):
            (folder / name).unlink(missing_ok=True)
        write_text(folder / CONFIGURATION, readable(configuration))
        _delete_results(folder)
    earlier = recorded_configuration(folder)
    if earlier is None:
        write_text(folder / CONFIGURATION, readable(configuration))
    else:
        _refuse_changes(earlier, configuration, ())
    if (folder / CONFIGURATION).is_file():
        sync_file(folder / CONFIGURATION)  # without it a power cut leaves a journal of nothing


def _refuse_changes(
    earlier: Configuration, configuration: Configuration, unknown: Sequence[str]
) -> None:
    before, now = (_flat(json.loads(canonical(c))) for c in (earlier, configuration))
    changed = sorted(
        key
        for key in {*before, *now}
        if before.get(key) != now.get(key) and key.partition(".")[0] not in unknown
    )
    if changed:
        shown = "; ".join(
            f"{key}: {short_json(before.get(key))} -> {short_json(now.get(key))}" for key in changed
        )
        raise ConfigurationMismatchError(
            "the run folder holds a run of another configuration",
            found=shown,
            expected="the same configuration, to resume",
            next_step="choose another -o, or pass --overwrite",
        )


def _flat(values: Mapping[str, Json], prefix: str = "") -> Mapping[str, Json]:
    """Nested objects as one, under dotted keys; an empty object stays itself."""
    flat: dict[str, Json] = {}
    for key, value in values.items():
        if isinstance(value, dict) and value:
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def divide_configuration(
    configuration: Configuration, images_per_file: int | None
) -> Configuration:
    """The configuration of the same run with another division; None: one file of predictions."""
    return structs.replace(configuration, images_per_file=images_per_file or UNSET)


def finish(
    folder: Path,
    *,
    records: Iterable[JournalledImage],
    run: RunFile,
    summary: RunSummary,
    with_predictions: bool,
    complete: Callable[[Path, Sequence[RunRow]], None] | None = None,
) -> None:
    """Write the canonical files, each whole or not at all, and drop the journal.

    run: without its scenes and hashes; its configuration says how many images' predictions a file
    holds. complete: writes the files that a family has of all its rows.
    """
    ordered = sorted(records, key=lambda r: r.row.image_id)
    before = _earlier_results(folder)
    if with_predictions:
        places = [r.at for r in ordered]
        per_file = run.configuration.images_per_file or None
        write_predictions(folder, per_file, predictions_at(folder, places), len(places))
    if complete is not None:
        complete(folder, [r.row for r in ordered])
    write_text(folder / ROWS, "".join(canonical(r.row) + "\n" for r in ordered))
    write_text(folder / SUMMARY, readable(summary))
    document = structs.replace(
        run,
        schema_version=RUN_SCHEMA,
        scenes={str(r.row.image_id): r.scene for r in ordered if r.scene},
        results_sha256=hashes(folder, _result_files(folder)),
    )
    if before is not None and before[1] == document.results_sha256:
        # Nothing came of doing it again: what was evaluated is still this run, its time too.
        again = structs.replace(document, finished_at=before[0].finished_at)
        document = again if canonical(again) == canonical(before[0]) else document
    write_text(folder / RUN, readable(document))
    _sync(folder, ordered)
    (folder / JOURNAL).unlink(missing_ok=True)
    (folder / CONFIGURATION).unlink(missing_ok=True)


def _sync(folder: Path, records: Sequence[JournalledImage]) -> None:
    """Have every result on disk: after the journal there is nothing to make them from."""
    own = [folder / file.file for r in records for file in r.row.files]
    results = [folder / RUN, *_result_files(folder), *own]
    for path in results:
        sync_file(path)
    inside = {parent for path in results for parent in path.parents}
    for place in sorted(p for p in inside if p == folder or folder in p.parents):
        sync_folder(place)


def _earlier_results(folder: Path) -> tuple[RunFile, Mapping[str, str]] | None:
    """run.json and the hashes of the results of a run that had ended; None where there is none."""
    try:
        document = decode(RunFile, (folder / RUN).read_bytes())
    except (OSError, RecordError):
        return None
    return document, hashes(folder, _result_files(folder))


def _result_files(folder: Path) -> list[Path]:
    """All that a finished run consists of but run.json and the files of its rows."""
    answers = [folder / ANSWERS] if (folder / ANSWERS).is_file() else []
    return [folder / ROWS, folder / SUMMARY, *answers, *present_files(folder)]


def _delete_results(folder: Path) -> None:
    for name in _RESULTS:
        (folder / name).unlink(missing_ok=True)
    delete_predictions(folder)
    for kind in FOLDERS:
        for path in sorted((folder / kind).rglob("*")):
            if path.suffix in _SUFFIXES and path.is_file():
                path.unlink()
