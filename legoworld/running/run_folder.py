"""The run folder: one writer at a time, a journal while it runs, canonical files at its end."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Final

from legoworld.errors import ConfigurationMismatchError, SceneInvalidError, UsageError
from legoworld.files import (
    TEMPORARY_SUFFIX,
    canonical_json,
    readable_json,
    sha256_of_file,
    write_text,
)
from legoworld.running.prediction_files import (
    IMAGES_PER_FILE,
    Prediction,
    delete_predictions,
    prediction_files,
    predictions_of,
    present_files,
    write_predictions,
)

RUN: Final = "run.json"
ROWS: Final = "per_image.jsonl"
SUMMARY: Final = "summary.json"
JOURNAL: Final = "journal.jsonl"
_CONFIGURATION: Final = "configuration.json"
_LOCK: Final = ".lock"
_TIME: Final = "finished_at"  # run.json's own, and the only time in a run
_RESULTS: Final = (RUN, ROWS, SUMMARY, JOURNAL)

Record = dict[str, Any]


class UnwritableRecordError(SceneInvalidError):
    """A record holds a text or a number that no JSON file can hold."""

    code = "unwritable_record"


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
    if not folder.exists() or recorded_configuration(folder) is not None:
        return
    strangers = sorted(p.name for p in folder.iterdir() if not _is_of_a_beginning(p.name))
    if strangers:
        raise ConfigurationMismatchError(
            "the output folder holds something that is not a run",
            found=", ".join(strangers[:5]),
            expected="an empty folder or an earlier run",
            next_step="choose another -o",
        )


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
    earlier = recorded_configuration(folder)
    if overwrite or earlier is None:
        return []
    _refuse_changes(earlier, configuration, unknown)
    return [*finished_records(folder), *_journal_records(folder)]


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


@contextmanager
def journal(folder: Path) -> Iterator[IO[bytes]]:
    """The open journal; see `append`."""
    path = folder / JOURNAL
    _drop_torn_line(path)
    with path.open("ab", buffering=0) as stream:
        yield stream


def append(stream: IO[bytes], record: Record) -> Record:
    """Put one record on disk before the next image is reported done.

    Returns it with the place in the journal instead of its predictions, for `finish`. Raises
    UnwritableRecordError for one that no JSON file can hold.
    """
    kept = {"row": record["row"], "scene": record["scene"], "journal_at": stream.tell()}
    line = _line_of(record)
    try:
        while line:
            line = line[stream.write(line) :]
        os.fsync(stream.fileno())
    except OSError as error:
        error.filename = error.filename or stream.name  # a full disk does not say which file
        raise
    return kept


def _line_of(record: Record) -> bytes:
    try:
        return (canonical_json(record) + "\n").encode("utf-8")
    except (ValueError, TypeError, RecursionError) as error:
        raise UnwritableRecordError(
            "what was read of the scene cannot be written as JSON",
            found=f"{type(error).__name__}: {error}",
            expected="text in Unicode and finite numbers",
            next_step="correct the names and properties of the scene",
        ) from error


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
        write_predictions(folder, per_file, _journalled(folder, places), len(places))
    write_text(folder / ROWS, "".join(canonical_json(r["row"]) + "\n" for r in ordered))
    write_text(folder / SUMMARY, readable_json(summary))
    scenes = {str(r["row"]["image_id"]): r["scene"] for r in ordered if r["scene"]}
    document = {**run, "scenes": scenes}
    if before is not None and before[1] == _hashes(folder):
        # Nothing came of doing it again: what was evaluated is still this run, its time too.
        again = {**document, _TIME: before[0].get(_TIME)}
        document = again if json.loads(canonical_json(again)) == before[0] else document
    write_text(folder / RUN, readable_json(document))
    (folder / JOURNAL).unlink(missing_ok=True)
    (folder / _CONFIGURATION).unlink(missing_ok=True)


def _earlier_results(folder: Path) -> tuple[dict[str, Any], dict[str, str]] | None:
    """run.json and the hashes of the results of a run that had ended; None where there is none."""
    try:
        document = json.loads((folder / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return (document, _hashes(folder)) if isinstance(document, dict) else None


def _hashes(folder: Path) -> dict[str, str]:
    results = [p for p in (folder / ROWS, folder / SUMMARY) if p.is_file()]
    return {
        path.relative_to(folder).as_posix(): sha256_of_file(path)
        for path in (*results, *present_files(folder))
    }


def _journalled(folder: Path, places: Sequence[int]) -> Iterator[list[Prediction]]:
    """The predictions of the records at these places of the journal."""
    with (folder / JOURNAL).open("rb") as stream:
        for place in places:
            stream.seek(place)
            yield json.loads(stream.readline())["predictions"]


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
    except (ValueError, KeyError, TypeError) as error:
        problem = f"{type(error).__name__}: {error}"
    raise ConfigurationMismatchError(
        f"{path.name} in the output folder is not of a run",
        found=problem,
        expected="an empty folder or an earlier run",
        next_step="choose another -o",
    )


def finished_records(folder: Path) -> Iterator[Record]:
    """Records of a run that has ended, put together again from its files; none otherwise.

    By ascending image id; predictions are read as the records are taken. The images of a file that
    is gone have none.
    """
    if not (folder / RUN).is_file() or not (folder / ROWS).is_file():
        return
    document = json.loads((folder / RUN).read_text(encoding="utf-8"))
    rows = sorted(map(json.loads, _lines(folder / ROWS)), key=lambda row: int(row["image_id"]))
    per_file = document["configuration"].get(IMAGES_PER_FILE)
    files = [f for f in prediction_files(folder, per_file, len(rows)) if f.is_file()]
    each = predictions_of([row["image_id"] for row in rows], files)
    for row, predictions in zip(rows, each, strict=True):
        scene = document["scenes"].get(str(row["image_id"]))
        yield {"row": row, "predictions": predictions, "scene": scene}


def _journal_records(folder: Path) -> list[Record]:
    path = folder / JOURNAL
    _drop_torn_line(path)
    if not path.is_file():
        return []
    return [json.loads(line) for line in _lines(path)]


def _lines(path: Path) -> list[str]:
    """Lines that end in a newline; a name may hold other characters that end lines elsewhere."""
    return [line for line in path.read_text(encoding="utf-8").split("\n") if line]


def _drop_torn_line(path: Path) -> None:
    """Cut the line a killed process left unfinished."""
    if not path.is_file():
        return
    data = path.read_bytes()
    whole = data.rfind(b"\n") + 1
    if whole != len(data):
        with path.open("r+b") as stream:
            stream.truncate(whole)


def _delete_results(folder: Path) -> None:
    for name in _RESULTS:
        (folder / name).unlink(missing_ok=True)
    delete_predictions(folder)
    depth = folder / "depth"
    for path in sorted(depth.rglob("*.npz")) if depth.is_dir() else ():
        path.unlink()


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
