"""The journal of a run that has not ended: one line per image, on disk before the next is done.

A line is a record as canonical JSON, a tab, and the checksum of the JSON: what a disk or a hand has
changed is no record, and its image is read again.
"""

from __future__ import annotations

import os
import zlib
from array import array
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

from legoworld.errors import LegoWorldError, SceneInvalidError
from legoworld.files import canonical_json, sync_folder
from legoworld.records.base import RecordError, as_json, canonical, decode
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.records.run_rows import RunRow

JOURNAL: Final = "journal.jsonl"

#: Canonical JSON has its keys in order, so a record's line begins with its predictions.
_BEFORE_PREDICTIONS: Final = b'{"predictions":['


@dataclass(frozen=True, kw_only=True)
class Places:
    """Where a record's predictions are: its line's offset, and the bytes of each of them."""

    line: int
    sizes: array[int]


@dataclass(frozen=True, kw_only=True)
class JournalledImage:
    """A record that is in the journal, with the places of its predictions instead of them."""

    row: RunRow
    scene: ImageSource | None
    at: Places


class UnwritableRecordError(SceneInvalidError):
    """A record holds a text or a number that no JSON file can hold."""

    code = "unwritable_record"


class JournalChangedError(LegoWorldError):
    """Something else than the run has written into its journal."""

    code = "journal_changed"


@contextmanager
def journal(folder: Path) -> Iterator[IO[bytes]]:
    """The open journal; see `append`."""
    path = folder / JOURNAL
    _drop_torn_line(path)
    with path.open("ab", buffering=0) as stream:
        sync_folder(folder)  # a journal whose name a power cut takes has nothing on disk
        yield stream


def append(stream: IO[bytes], record: ImageRecord) -> JournalledImage:
    """Put one record on disk before the next image is reported done.

    Raises UnwritableRecordError for one that no JSON file can hold.
    """
    line, places = _encode_line(record, stream.tell())
    try:
        while line:
            line = line[stream.write(line) :]
        os.fsync(stream.fileno())
    except OSError as error:
        error.filename = error.filename or stream.name  # a full disk does not say which file
        raise
    return JournalledImage(row=record.row, scene=record.scene, at=places)


def journal_records(folder: Path) -> tuple[list[ImageRecord], int]:
    """The records in a folder's journal, and how many lines hold none that can be used."""
    path = folder / JOURNAL
    _drop_torn_line(path)
    if not path.is_file():
        return [], 0
    with path.open("rb") as stream:
        records = [_record_in(line) for line in stream]
    good = [record for record in records if record is not None]
    return good, len(records) - len(good)


def rows_after(folder: Path, at: int) -> tuple[list[RunRow], int]:
    """The rows of a journal's whole lines from byte `at` on, and where the last of them ends.

    The run may be writing it: a line that is not whole yet is left for the next time.
    """
    with (folder / JOURNAL).open("rb") as stream:
        stream.seek(at)
        lines = [line for line in stream if line.endswith(b"\n")]
    records = [_record_in(line) for line in lines]
    return [record.row for record in records if record], at + sum(map(len, lines))


def predictions_at(folder: Path, places: Iterable[Places]) -> Iterator[list[str]]:
    """The predictions of the records at these places of the journal, as canonical JSON each.

    They are cut out of the line: reading it as JSON and writing that again would give the same.
    Raises JournalChangedError where a line is another.
    """
    with (folder / JOURNAL).open("rb") as stream:
        for place in places:
            stream.seek(place.line)
            data = _check_line(stream.readline())
            if data is None:
                raise JournalChangedError(
                    f"{JOURNAL} was changed while the run was writing it",
                    found=f"another text at byte {place.line} of {folder.name}/{JOURNAL}",
                    expected="what the run wrote there",
                    next_step="let nothing else write into the run folder, and run the same again",
                )
            at, texts = len(_BEFORE_PREDICTIONS), []
            for size in place.sizes:
                texts.append(data[at : at + size].decode("utf-8"))
                at += size + 1  # the comma
            yield texts


def _encode_line(record: ImageRecord, at: int) -> tuple[bytes, Places]:
    """The line of a record that is put at this place, and where its predictions are."""
    try:
        predictions = [canonical(p).encode("utf-8") for p in record.predictions]
        kept = {"row": as_json(record.row), "scene": as_json(record.scene)}
        rest = canonical_json(kept).encode("utf-8")
    except (ValueError, TypeError, RecursionError) as error:
        raise UnwritableRecordError(
            "what was read of the scene cannot be written as JSON",
            found=f"{type(error).__name__}: {error}",
            expected="text in Unicode and finite numbers",
            next_step="correct the names and properties of the scene",
        ) from error
    data = b"".join((_BEFORE_PREDICTIONS, b",".join(predictions), b"],", rest[1:]))
    sizes = array("Q", map(len, predictions))
    return data + b"\t%08x\n" % zlib.crc32(data), Places(line=at, sizes=sizes)


def _record_in(line: bytes) -> ImageRecord | None:
    """The record of a line; None for one that is not as it was written."""
    data = _check_line(line)
    try:
        return None if data is None else decode(ImageRecord, data)
    except RecordError:  # of another version
        return None


def _check_line(line: bytes) -> bytes | None:
    data, tab, checksum = line.rstrip(b"\n").rpartition(b"\t")
    return data if tab and checksum == b"%08x" % zlib.crc32(data) else None


def _drop_torn_line(path: Path) -> None:
    """Cut the line a killed process left unfinished."""
    if not path.is_file():
        return
    data = path.read_bytes()
    whole = data.rfind(b"\n") + 1
    if whole != len(data):
        with path.open("r+b") as stream:
            stream.truncate(whole)
