"""What a trial leaves behind: its calls, and the scene after each call that changed it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal, TypeVar

from legoworld.beneath import Beneath, RefusedFileError
from legoworld.files import atomic_path, sha256_of_file
from legoworld.records.base import Record, RecordError, canonical, decode
from legoworld.records.endpoint import Call, Checkpoint
from legoworld.scene.folder import BLEND

CALLS: Final = "calls.jsonl"
CHECKPOINTS: Final = "checkpoints.jsonl"
STORE: Final = "checkpoints"
#: Of a file that is taken out of a program's folder: its sandbox writes none that is larger.
LARGEST_FILE: Final = 4 << 30
#: A .blend as it is, or compressed by Zstandard or, before Blender 3.0, gzip.
_BLENDS: Final = (b"BLENDER", b"\x28\xb5\x2f\xfd", b"\x1f\x8b")
_Row = TypeVar("_Row", bound=Record)


class TrialRecord:
    """A folder: calls.jsonl, checkpoints.jsonl and checkpoints/<sha256>.blend.

    The store is addressed by content: a scene that comes back is kept once. A folder that has rows
    already is continued.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._store = folder / STORE
        self._store.mkdir(parents=True, exist_ok=True)
        #: Why the last examined scene.blend is not a checkpoint; "" if it is one.
        self.spoilt = ""
        self.calls = read_rows(folder / CALLS, Call)
        self.checkpoints = read_rows(folder / CHECKPOINTS, Checkpoint)

    def blend(self, checkpoint: Checkpoint) -> Path:
        """The file of a checkpoint."""
        return self._store / f"{checkpoint.sha256}.blend"

    def last(self, kind: Literal["live", "saved"]) -> Checkpoint | None:
        """The latest checkpoint of a kind."""
        return next((c for c in reversed(self.checkpoints) if c.kind == kind), None)

    def newest(self, kind: Literal["live", "saved"]) -> list[Checkpoint]:
        """The checkpoints of a kind, newest first, each content once: where it was left last."""
        found: dict[str, Checkpoint] = {}
        for checkpoint in reversed(self.checkpoints):
            if checkpoint.kind == kind:
                found.setdefault(checkpoint.sha256, checkpoint)
        return list(found.values())

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
        append_row(self.folder / CHECKPOINTS, row)
        return row

    def keep_saved(self, workspace: Path, *, call: int, at_s: float) -> Checkpoint | None:
        """Store a workspace's scene.blend as the next checkpoint; None if it is unchanged.

        `spoilt` says why a file was rejected.
        """
        self.spoilt = ""
        try:
            copy, last = self.copy_incoming(workspace.resolve(), BLEND), self.last("saved")
        except RefusedFileError as error:
            self.spoilt = f"saved by call {call}: {error.found}"
            return None
        if copy is None:
            return None
        if last is not None and last.sha256 == copy[1]:
            copy[0].unlink()
            return None
        return self.take(*copy, kind="saved", call=call, at_s=at_s)

    def copy_incoming(self, folder: Path, name: str) -> tuple[Path, str] | None:
        """A copy beside the store of a .blend that a program left below `folder`, and its sha256.

        For `take`, or to unlink; None where there is none. RefusedFileError for anything else.
        """
        copy = self._store / "incoming.blend"
        with Beneath(folder) as inside:
            if not inside.copy_out(name, copy, most_bytes=LARGEST_FILE):
                return None
        with copy.open("rb") as stream:
            begins = stream.read(8)
        if not begins.startswith(_BLENDS):
            copy.unlink()
            raise RefusedFileError(f"{name} is not a .blend", found=f"it begins with {begins!r}")
        return copy, sha256_of_file(copy)

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
        append_row(self.folder / CALLS, call)


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


def append_row(path: Path, row: Record) -> None:
    """Add a row to a JSON Lines file."""
    with path.open("ab") as stream:
        stream.write(canonical(row).encode("utf-8", "backslashreplace") + b"\n")
