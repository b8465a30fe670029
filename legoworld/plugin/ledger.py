"""ledger.jsonl: append-only, each line hashed together with the line before it."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from legoworld.errors import LegoWorldError, NotAssessedError, UsageError
from legoworld.files import Json, sha256_of_text
from legoworld.records.base import RecordError, canonical, decode
from legoworld.records.plugin_ledger import Entry, Phase

LEDGER: Final = "ledger.jsonl"
_FIRST: Final = "0" * 64


class LedgerBrokenError(LegoWorldError):
    """A line of a ledger is not what was written, or not where it was written."""

    code = "ledger_broken"


class Ledger:
    """A ledger that is open for writing: every entry is on disk before its call is answered."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / LEDGER
        self.entries, whole = _read_entries(self.path)
        if self.path.exists() and whole < self.path.stat().st_size:
            # A line that was being written when the process was killed: its call was not answered.
            with self.path.open("rb+") as stream:
                stream.truncate(whole)
        #: Of all that is in the file, as far as this process knows.
        self._written_hash = hashlib.sha256(self._bytes())

    def append(
        self,
        *,
        tool: str,
        request: Mapping[str, Json],
        answer: Json,
        error: str | None,
        phase: Phase,
        transaction: int | None,
        signatures: tuple[str | None, str | None],
        base_sha256: str | None,
    ) -> Entry:
        """Write an entry and have it on disk.

        LedgerBrokenError if the file changed since it was last read or written here.
        """
        if hashlib.sha256(self._bytes()).digest() != self._written_hash.digest():
            raise LedgerBrokenError(
                f"{LEDGER} was changed by another program",
                found="another file than the one this server wrote",
                expected=f"{len(self.entries)} lines as they were written",
                next_step="end this server, and begin another case with another --ledger",
            )
        unsigned = Entry(
            seq=len(self.entries) + 1,
            previous=self.entries[-1].sha256 if self.entries else _FIRST,
            tool=tool,
            request=dict(request),
            answer=answer,
            error=error,
            phase=phase,
            transaction=transaction,
            geometry_signature=signatures[0],
            scene_signature=signatures[1],
            base_sha256=base_sha256,
        )
        entry, line = _encode_entry(unsigned)
        with self.path.open("ab") as stream:
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
        self._written_hash.update(line)
        self.entries.append(entry)
        return entry

    def _bytes(self) -> bytes:
        return self.path.read_bytes() if self.path.exists() else b""


def _encode_entry(unsigned: Entry) -> tuple[Entry, bytes]:
    """An entry with its hash, and its line. UsageError for one that could not be read again."""
    try:
        entry = msgspec.structs.replace(unsigned, sha256=_sha256(unsigned))
        line = canonical(entry).encode()
        if canonical(decode(Entry, line)).encode() == line:
            return entry, line + b"\n"
        found = "a value that is read as another"
    except ValueError as error:  # NaN, halves of surrogate pairs
        found = str(error)
    raise UsageError(
        f"the call of {unsigned.tool} cannot be recorded",
        found=found,
        expected="numbers and texts that JSON can hold",
    )


def read_ledger(folder: Path) -> list[Entry]:
    """Read a ledger and check its hashes. LedgerBrokenError names the first bad line.

    A last line without its end was being written when the process was killed, and is left out.
    """
    return _read_entries(folder / LEDGER)[0]


def plugin_replay(ledger: str | Path) -> list[Entry]:
    """The entries of a ledger whose chain of hashes is whole.

    LedgerBrokenError for another one, NotAssessedError without a ledger or an entry.
    """
    folder = Path(ledger)
    entries = read_ledger(folder)
    if not entries:
        raise NotAssessedError(
            f"{folder} holds no ledger to check",
            found="no entry" if (folder / LEDGER).exists() else f"no {LEDGER}",
            expected="the folder that `legoworld plugin serve --ledger` wrote",
        )
    return entries


def _read_entries(path: Path) -> tuple[list[Entry], int]:
    """The entries, and how many bytes of the file they take."""
    data = path.read_bytes() if path.exists() else b""
    whole = data.rfind(b"\n") + 1
    entries: list[Entry] = []
    for number, line in enumerate(data[:whole].splitlines(), start=1):
        try:
            entry = decode(Entry, line)
        except RecordError as error:
            raise _broken_line(number, str(error)) from error
        previous = entries[-1].sha256 if entries else _FIRST
        if entry.seq != number:
            raise _broken_line(number, f"entry {entry.seq}")
        if entry.previous != previous:
            raise _broken_line(number, "it does not follow the line before")
        if _sha256(entry) != entry.sha256 or canonical(entry).encode() != line:
            raise _broken_line(number, "it was changed after it was written")
        entries.append(entry)
    return entries, whole


def _sha256(entry: Entry) -> str:
    return sha256_of_text(canonical(msgspec.structs.replace(entry, sha256="")))


def _broken_line(number: int, found: str) -> LedgerBrokenError:
    return LedgerBrokenError(
        f"line {number} of {LEDGER} cannot be trusted",
        found=found,
        expected="the lines as they were written",
        next_step="keep the ledger as it is, and begin another case with another --ledger",
    )
