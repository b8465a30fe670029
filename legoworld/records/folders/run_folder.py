"""The run folder: one writer at a time, a journal while it runs, canonical files at its end."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from legoworld.errors import ConfigurationMismatchError, UsageError
from legoworld.files import (
    TEMPORARY_SUFFIX,
    canonical_json,
    readable_json,
    refused_by_machine,
    sync_file,
    sync_folder,
    write_text,
)
from legoworld.records.folders.prediction_files import (
    FOLDER,
    IMAGES_PER_FILE,
    PREDICTIONS,
    delete_predictions,
    prediction_files,
    predictions_of,
    present_files,
    write_predictions,
)
from legoworld.records.folders.result_hashes import RESULTS, RUN_SCHEMA, altered, hashes
from legoworld.records.folders.row_files import FOLDERS, delete_files, files_of
from legoworld.records.folders.run_journal import (
    JOURNAL,
    Record,
    UnwritableRecordError,
    append,
    journal,
    journal_records,
    predictions_at,
)

RUN: Final = "run.json"
ROWS: Final = "per_image.jsonl"
SUMMARY: Final = "summary.json"
_CONFIGURATION: Final = "configuration.json"
__all__ = ["JOURNAL", "Record", "UnwritableRecordError", "append", "journal"]
_LOCK: Final = ".lock"
_TIME: Final = "finished_at"  # run.json's own, and the only time in a run
_RESULTS: Final = (RUN, ROWS, SUMMARY, JOURNAL)
#: All that a run writes into its folder, and what of it only a run has.
_OF_A_RUN: Final = {*_RESULTS, _CONFIGURATION, _LOCK, PREDICTIONS, FOLDER, *FOLDERS}
_OF_A_RUN_ALONE: Final = {ROWS, JOURNAL, _LOCK}


class RunDamagedError(ConfigurationMismatchError):
    """A file of a run folder is not what a run writes."""

    code = "run_damaged"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a run folder for this process alone. UsageError when another one has it."""
    refuse_strangers(folder)
    folder.mkdir(parents=True, exist_ok=True)
    # The lock's file stays: removing it would let two processes lock two files of one name.
    with (folder / _LOCK).open("a") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise UsageError(
                "another process is writing into the run folder",
                found=f"{folder.name}/{_LOCK} is held",
                expected="one run per folder",
                next_step="wait for it, or choose another -o",
            ) from error
        yield


def refuse_strangers(folder: Path) -> None:
    """Refuse a folder that holds something else than a run, before anything in it is touched."""
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
    return name in _OF_A_RUN or (name.startswith(".") and name.endswith(TEMPORARY_SUFFIX))


def _is_of_a_beginning(name: str) -> bool:
    """Whether a run that was killed before its configuration was on record left the file."""
    unfinished = name.startswith(f".{_CONFIGURATION}.") and name.endswith(TEMPORARY_SUFFIX)
    return name == _LOCK or unfinished


def prepare(folder: Path, configuration: dict[str, Any], *, overwrite: bool) -> list[Record]:
    """Make the folder ready for a run and return the records it already has.

    ConfigurationMismatchError names the keys that differ from an earlier run; with `overwrite`
    the earlier results are deleted.
    """
    records = earlier_records(folder, configuration, overwrite=overwrite)
    begin(folder, configuration, overwrite=overwrite)
    return records


def earlier_records(
    folder: Path, configuration: dict[str, Any], *, overwrite: bool, unknown: Sequence[str] = ()
) -> list[Record]:
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


def begin(folder: Path, configuration: dict[str, Any], *, overwrite: bool) -> None:
    """Put the configuration on record, after the same check; with `overwrite` results go first."""
    if overwrite:
        # Whenever this is interrupted, the folder is still known as a run's, and no result of the
        # earlier one can be taken for this one's.
        for name in (JOURNAL, ROWS):
            (folder / name).unlink(missing_ok=True)
        write_text(folder / _CONFIGURATION, readable_json(configuration))
        _delete_results(folder)
    for leftover in folder.rglob(f".*{TEMPORARY_SUFFIX}"):
        if leftover.is_file():
            leftover.unlink()
    earlier = recorded_configuration(folder)
    if earlier is None:
        write_text(folder / _CONFIGURATION, readable_json(configuration))
    else:
        _refuse_changes(earlier, configuration, ())
    if (folder / _CONFIGURATION).is_file():
        sync_file(folder / _CONFIGURATION)  # without it a power cut leaves a journal of nothing


def _refuse_changes(
    earlier: dict[str, Any], configuration: dict[str, Any], unknown: Sequence[str]
) -> None:
    before = _flat({k: v for k, v in earlier.items() if k not in unknown})
    now = _flat({k: v for k, v in configuration.items() if k not in unknown})
    changed = sorted(key for key in {*before, *now} if before.get(key) != now.get(key))
    if changed:
        shown = "; ".join(
            f"{key}: {_short(before.get(key))} -> {_short(now.get(key))}" for key in changed
        )
        raise ConfigurationMismatchError(
            "the run folder holds a run of another configuration",
            found=shown,
            expected="the same configuration, to resume",
            next_step="choose another -o, or pass --overwrite",
        )


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested objects as one, under dotted keys; an empty object stays itself."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict) and value:
            found |= _flat(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = value
    return found


def finish(
    folder: Path,
    *,
    records: Iterable[Record],
    run: dict[str, Any],
    summary: dict[str, Any],
    with_predictions: bool,
) -> None:
    """Write the canonical files, each whole or not at all, and drop the journal.

    The configuration in `run` says how many images' predictions a file holds.
    """
    ordered = sorted(records, key=lambda r: int(r["row"]["image_id"]))
    before = _earlier_results(folder)
    if with_predictions:
        places = [r["journal_at"] for r in ordered]
        per_file = run["configuration"].get(IMAGES_PER_FILE)
        write_predictions(folder, per_file, predictions_at(folder, places), len(places))
    write_text(folder / ROWS, "".join(canonical_json(r["row"]) + "\n" for r in ordered))
    write_text(folder / SUMMARY, readable_json(summary))
    scenes = {str(r["row"]["image_id"]): r["scene"] for r in ordered if r["scene"]}
    results = hashes(folder, _result_files(folder))
    document = {**run, "schema_version": RUN_SCHEMA, "scenes": scenes, RESULTS: results}
    if before is not None and before[1] == results:
        # Nothing came of doing it again: what was evaluated is still this run, its time too.
        again = {**document, _TIME: before[0].get(_TIME)}
        document = again if json.loads(canonical_json(again)) == before[0] else document
    write_text(folder / RUN, readable_json(document))
    _sync(folder, ordered)
    (folder / JOURNAL).unlink(missing_ok=True)
    (folder / _CONFIGURATION).unlink(missing_ok=True)


def _sync(folder: Path, records: Sequence[Record]) -> None:
    """Have every result on disk: after the journal there is nothing to make them from."""
    own = [folder / file["file"] for r in records for file in files_of(r["row"])]
    results = [folder / RUN, *_result_files(folder), *own]
    for path in results:
        sync_file(path)
    inside = {parent for path in results for parent in path.parents}
    for place in sorted(p for p in inside if p == folder or folder in p.parents):
        sync_folder(place)


def _earlier_results(folder: Path) -> tuple[dict[str, Any], dict[str, str]] | None:
    """run.json and the hashes of the results of a run that had ended; None where there is none."""
    try:
        document = json.loads((folder / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    found = hashes(folder, _result_files(folder))
    return (document, found) if isinstance(document, dict) else None


def _result_files(folder: Path) -> list[Path]:
    """All that a finished run consists of but run.json and the files of its rows."""
    return [folder / ROWS, folder / SUMMARY, *present_files(folder)]


def recorded_configuration(folder: Path) -> dict[str, Any] | None:
    """The configuration of the run in a folder, finished or not; None when there is none."""
    for name in (_CONFIGURATION, RUN):
        path = folder / name
        if path.is_file():
            return _configuration_in(path, name)
    return None


def _configuration_in(path: Path, name: str) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        found = document["configuration"] if name == RUN else document
        if isinstance(found, dict) and "task" in found:
            return found
        problem = "no configuration in it"
    except OSError as error:
        if refused_by_machine(error):
            raise
        problem = error.strerror or type(error).__name__
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        problem = f"{type(error).__name__}: {error}"
    raise RunDamagedError(
        f"{path.name} in the output folder is not of a run",
        found=problem,
        expected="an empty folder or an earlier run",
        next_step="choose another -o, or pass --overwrite where it is a damaged run",
    )


def finished_records(folder: Path) -> Iterator[Record]:
    """Records of a run that has ended, put together again from its files; none otherwise.

    By ascending image id; predictions are read as the records are taken. The images of a file that
    is gone, or is not the one the run wrote, have none.
    """
    if not (folder / RUN).is_file() or not (folder / ROWS).is_file():
        return
    rows, document = _finished(folder)
    per_file = document["configuration"].get(IMAGES_PER_FILE)
    files = [f for f in prediction_files(folder, per_file, len(rows)) if f.is_file()]
    lost = altered(folder, document, files)
    files = [f for f in files if f.relative_to(folder).as_posix() not in lost]
    each = predictions_of([row["image_id"] for row in rows], files)
    for row, predictions in zip(rows, each, strict=True):
        scene = document["scenes"].get(str(row["image_id"]))
        yield {"row": row, "predictions": predictions, "scene": scene}


def _finished(folder: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The rows of a finished run by ascending image id, and run.json."""
    name = RUN
    try:
        document = json.loads((folder / RUN).read_text(encoding="utf-8"))
        per_file = document["configuration"].get(IMAGES_PER_FILE)
        if not isinstance(document["scenes"], dict) or not isinstance(per_file, int | None):
            raise TypeError("not as a run writes it")
        name = ROWS
        # Beside a journal the results are being written anew, and run.json is of those before.
        if not (folder / JOURNAL).is_file():
            refuse_altered(folder, document, [folder / ROWS])
        rows = [json.loads(line) for line in _lines(folder / ROWS)]
        ids = [row["image_id"] for row in rows if {"status", "warnings"} <= row.keys()]
        if len({*ids}) != len(rows) or any(type(i) is not int for i in ids):
            raise TypeError("rows that are not one of each image")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise RunDamagedError(
            f"{folder.name}/{name} cannot be read",
            found=getattr(error, "strerror", None) or f"{type(error).__name__}: {error}",
            expected="what a finished run writes",
            next_step="run its command again with --overwrite",
        ) from error
    return sorted(rows, key=lambda row: int(row["image_id"])), document


def refuse_altered(folder: Path, document: Any, files: Iterable[Path]) -> None:
    """RunDamagedError where a file is not the one that run.json, `document`, has on record."""
    for name in altered(folder, document, files):
        raise RunDamagedError(
            f"{folder.name}/{name} is not the one that the run wrote",
            found="another sha256",
            expected=f"the sha256 in {RUN}",
            next_step="run its command again with --overwrite",
        )


def _lines(path: Path) -> list[str]:
    """Lines that end in a newline; a name may hold other characters that end lines elsewhere."""
    return [line for line in path.read_text(encoding="utf-8").split("\n") if line]


def _delete_results(folder: Path) -> None:
    for name in _RESULTS:
        (folder / name).unlink(missing_ok=True)
    delete_predictions(folder)
    delete_files(folder)


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
