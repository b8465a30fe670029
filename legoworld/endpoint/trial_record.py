"""What a trial leaves behind: its calls, and the scene after each call that changed it."""

from __future__ import annotations

import os
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal, TypeVar

from legoworld.files import atomic_path
from legoworld.records.base import Record, RecordError, canonical, decode
from legoworld.records.endpoint import Call, Checkpoint

CALLS: Final = "calls.jsonl"
CHECKPOINTS: Final = "checkpoints.jsonl"
STORE: Final = "checkpoints"
_LARGEST_SAVED: Final = 4 << 30
_Row = TypeVar("_Row", Call, Checkpoint)


class TrialRecord:
    """A folder: calls.jsonl, checkpoints.jsonl and checkpoints/<sha256>.blend.

    The store is addressed by content: a scene that comes back is kept once. A folder that has rows
    already is continued.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._store = folder / STORE
        self._store.mkdir(parents=True, exist_ok=True)
        self.calls = read_rows(folder / CALLS, Call)
        self.checkpoints = read_rows(folder / CHECKPOINTS, Checkpoint)

    def blend(self, checkpoint: Checkpoint) -> Path:
        """The file of a checkpoint."""
        return self._store / f"{checkpoint.sha256}.blend"

    def last(self, kind: Literal["live", "saved"]) -> Checkpoint | None:
        """The latest checkpoint of a kind."""
        return next((c for c in reversed(self.checkpoints) if c.kind == kind), None)

    def take(
        self, file: Path, sha256: str, *, kind: Literal["live", "saved"], call: int, at_s: float
    ) -> Checkpoint:
        """Move a file with this hash into the store, as the next checkpoint."""
        row = Checkpoint(
            ordinal=max((c.ordinal for c in self.checkpoints), default=0) + 1,
            sha256=sha256,
            bytes=file.stat().st_size,
            call=call,
            at_s=round(at_s, 4),
            kind=kind,
        )
        file.replace(self.blend(row))  # the same content, where it is there
        self.checkpoints.append(row)
        _append(self.folder / CHECKPOINTS, row)
        return row

    def incoming(self) -> Path:
        """A folder to move files into before `take`, on the same file system as the store."""
        return self._store

    def drop_unanswered(self) -> None:
        """Forget the open scene after a call that has no row: its client had no answer.

        Whoever repeats that call finds the scene as the last answered one left it.
        """
        answered = len(self.calls)
        kept = [c for c in self.checkpoints if c.kind == "saved" or c.call <= answered]
        if len(kept) != len(self.checkpoints):
            with atomic_path(self.folder / CHECKPOINTS) as unfinished:
                write_rows(unfinished, kept)
            self.checkpoints = kept

    def note(self, call: Call) -> None:
        """Keep a call's row."""
        self.calls.append(call)
        _append(self.folder / CALLS, call)


def read_rows(path: Path, kind: type[_Row]) -> list[_Row]:
    """The rows of a JSON Lines file; one that a killed process left unfinished is dropped."""
    if not path.is_file():
        return []
    rows = []
    for line in path.read_bytes().split(b"\n"):
        try:
            rows.append(decode(kind, line))
        except RecordError:
            continue
    return rows


def write_rows(path: Path, rows: Sequence[Record]) -> None:
    """Write rows as JSON Lines."""
    path.write_text("".join(canonical(row) + "\n" for row in rows), encoding="utf-8")


def _append(path: Path, row: Record) -> None:
    with path.open("ab") as stream:
        stream.write(canonical(row).encode("utf-8", "backslashreplace") + b"\n")


def copy_regular(source: Path, target: Path) -> bool:
    """Copy a file that an untrusted program left; False where there is none that may be copied.

    A link is not followed: it may name what only we can read.
    """
    try:
        descriptor = os.open(source, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return False
    with os.fdopen(descriptor, "rb") as stream:
        status = os.fstat(stream.fileno())
        if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1:
            return False
        if status.st_size > _LARGEST_SAVED:
            return False
        with target.open("wb") as copy:
            while data := stream.read(1 << 20):
                copy.write(data)
    return True
