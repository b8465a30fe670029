"""What lies below a folder at this moment: runs and trials, also unfinished ones, and results.

Nothing is written, and nothing is kept open. A program may be writing what is read here: what is
half written is read again at the next look.
"""

from __future__ import annotations

import os
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Final, Literal

from legoworld.agents.unfinished_trial import BEGUN, WORKSPACE, UnfinishedTrial
from legoworld.agents.workspaces import REFERENCE
from legoworld.beneath import Beneath, RefusedFileError
from legoworld.comparison.folder import COMPARISON, read_comparison
from legoworld.comparison.tables import list_comparisons
from legoworld.endpoint.trial_record import CALLS
from legoworld.errors import LegoWorldError, cause, one_line
from legoworld.records.agents import ReconstructionFile
from legoworld.records.base import Record, RecordError, decode, decode_lines
from legoworld.records.evaluation import Summary
from legoworld.records.folders.read_evaluation import EVIDENCE, read_summary
from legoworld.records.folders.read_run import (
    CONFIGURATION,
    ROWS,
    RUN,
    SUMMARY,
    recorded_configuration,
)
from legoworld.records.folders.run_journal import JOURNAL, rows_after
from legoworld.records.run_file import RunHead
from legoworld.records.run_rows import RunRow
from legoworld.scene.folder import PICTURE
from legoworld.tables.table import Number
from legoworld.trajectories.folder import RECONSTRUCTION, TRIAL

#: Rows of one folder that are shown, the newest; folders that are looked into.
_MOST_ROWS: Final = 60
_MOST_FOLDERS: Final = 20_000
_DEEPEST: Final = 5
_END_BYTES: Final = 64
#: The files that tell what a folder is; below such a folder is nothing of its own.
_TELLING: Final = {COMPARISON, CONFIGURATION, RUN, EVIDENCE, RECONSTRUCTION, BEGUN}
PICTURES: Final = (".png", ".jpg", ".jpeg", ".webp")
Kind = Literal["run", "evaluation", "comparison", "trials"]


class WatchedRow(Record, frozen=True, kw_only=True):
    """An image of a run, or a trial. picture: its path below the folder that is watched."""

    name: str
    status: str
    note: str = ""
    picture: str | None = None


class Watched(Record, frozen=True, kw_only=True):
    """A folder of one kind. name: its path below the folder that is watched.

    done, of: images or trials, `of` null where their number is not known; rows: of an unfinished
    run the newest first, of an ended one those that are not ok, of trials those that go on first;
    page: whether there is one of it, not of a run, which nothing has scored; result: the first
    metric of an evaluation; problem: why the folder cannot be read.
    """

    name: str
    kind: Kind
    task: str = ""
    finished: bool = True
    done: int = 0
    of: int | None = None
    statuses: Mapping[str, int] = {}
    rows: tuple[WatchedRow, ...] = ()
    page: bool = False
    result: str = ""
    problem: str | None = None


class WatchedState(Record, frozen=True, kw_only=True):
    """All that is there now, by name. left_out: whether more folders are there than looked into."""

    folder: str
    sources: tuple[Watched, ...]
    left_out: bool


@dataclass(kw_only=True)
class _Journal:
    """As much of an unfinished run's journal as was read. inode, end: what tells it from another.

    end: the bytes before `at`, which hold the checksum of the last record.
    """

    at: int = 0
    inode: int = 0
    end: bytes = b""
    statuses: Counter[str] = field(default_factory=Counter)
    newest: list[RunRow] = field(default_factory=list)


class Watch:
    """Looks at a folder again and again; a result or run that has not changed is not read twice."""

    def __init__(self, top: Path) -> None:
        self.top = top.resolve()
        self._journals: dict[Path, _Journal] = {}
        self._ended_trials: dict[Path, tuple[int, WatchedRow]] = {}
        self._read: dict[Path, tuple[tuple[int, ...], Watched]] = {}
        self._looking = threading.Lock()

    def look(self) -> WatchedState:
        """What is there now. Two looks at once would count a journal's new rows twice."""
        with self._looking:
            return self._look()

    def _look(self) -> WatchedState:
        walked = list(islice(_walk(self.top), _MOST_FOLDERS + 1))
        found: list[Watched] = []
        trials: dict[Path, list[tuple[Path, bool]]] = {}
        for folder, files in walked[:_MOST_FOLDERS]:
            if RECONSTRUCTION in files or BEGUN in files:
                trials.setdefault(folder.parent, []).append((folder, RECONSTRUCTION in files))
            elif read := next((read for name, read in self._kinds() if name in files), None):
                found.append(read(folder))
        found += [self._trials(folder, inside) for folder, inside in trials.items()]
        found.sort(key=lambda one: one.name)
        return WatchedState(
            folder=self.top.name, sources=tuple(found), left_out=len(walked) > _MOST_FOLDERS
        )

    def _kinds(self) -> Sequence[tuple[str, Callable[[Path], Watched]]]:
        """The file that tells what a folder is, and how such a folder is read; the first counts."""
        return (
            (
                COMPARISON,
                lambda of: self._reread(of / COMPARISON, "comparison", self._comparison),
            ),
            (CONFIGURATION, self._unfinished_run),
            (RUN, lambda of: self._reread(of / RUN, "run", self._run)),
            (EVIDENCE, lambda of: self._reread(of / SUMMARY, "evaluation", self._evaluation)),
        )

    def _reread(self, path: Path, kind: Kind, read: Callable[[Path], Watched]) -> Watched:
        """What was read of a folder, while the file that tells of it is the same."""
        try:
            status = path.stat()
            signature = (status.st_ino, status.st_size, status.st_mtime_ns)
            known = self._read.get(path)
            if known is None or known[0] != signature:
                known = self._read[path] = (signature, read(path.parent))
        except (OSError, RecordError, LegoWorldError) as error:
            return Watched(name=self._name(path.parent), kind=kind, problem=_reason(error))
        return known[1]

    def _comparison(self, folder: Path) -> Watched:
        document = read_comparison(folder / COMPARISON)
        tasks = [one.task for one in list_comparisons(document)]
        return Watched(name=self._name(folder), kind="comparison", task=", ".join(tasks), page=True)

    def _run(self, folder: Path) -> Watched:
        """A run that has ended, with the rows that are not ok."""
        rows = decode_lines(RunRow, (folder / ROWS).read_bytes())
        configuration = decode(RunHead, (folder / RUN).read_bytes()).configuration
        return Watched(
            name=self._name(folder),
            kind="run",
            task=configuration.task,
            done=len(rows),
            of=configuration.attempted,
            statuses=dict(sorted(Counter(row.status for row in rows).items())),
            rows=_watched_rows(row for row in rows if row.status != "ok"),
        )

    def _evaluation(self, folder: Path) -> Watched:
        summary = read_summary(folder)
        cover = summary.coverage
        return Watched(
            name=self._name(folder), kind="evaluation", task=summary.task, done=cover.scored,
            result=_first_metric(summary),
            of=cover.attempted, statuses=cover.by_status, page=True,
        )  # fmt: skip

    def _unfinished_run(self, folder: Path) -> Watched:
        path = folder / JOURNAL
        try:
            configuration = recorded_configuration(folder)
            inode = path.stat().st_ino if path.exists() else 0
            journal = self._journals.get(folder, _Journal())
            if journal.inode != inode or journal.end != _end(path, journal.at):  # begun anew
                journal = _Journal(inode=inode)
            self._journals[folder] = journal
            rows, journal.at = rows_after(folder, journal.at) if inode else ([], 0)
            journal.end = _end(path, journal.at)
        except (OSError, LegoWorldError) as error:
            return Watched(name=self._name(folder), kind="run", problem=_reason(error))
        journal.statuses.update(row.status for row in rows)
        journal.newest = [*journal.newest, *rows][-_MOST_ROWS:]
        return Watched(
            name=self._name(folder),
            kind="run",
            task=configuration.task if configuration else "",
            finished=False,
            done=journal.statuses.total(),
            of=configuration.attempted if configuration else None,
            statuses=dict(sorted(journal.statuses.items())),
            rows=_watched_rows(reversed(journal.newest)),
        )

    def _trials(self, folder: Path, inside: Iterable[tuple[Path, bool]]) -> Watched:
        ended = [self._ended_trial(one) for one, finished in sorted(inside) if finished]
        going = [self._running_trial(one) for one, finished in sorted(inside) if not finished]
        newest = [row for _, row in sorted(ended, key=lambda one: one[0], reverse=True)]
        statuses = Counter(row.status for row in [*going, *newest])
        return Watched(
            name=self._name(folder),
            kind="trials",
            finished=not going,
            done=len(ended),
            page=bool(ended),
            statuses=dict(sorted(statuses.items())),
            rows=(*going, *newest)[:_MOST_ROWS],
        )

    def _ended_trial(self, folder: Path) -> tuple[int, WatchedRow]:
        """When it ended, and its row; read again only when its record is another file."""
        path = folder / RECONSTRUCTION
        try:
            status = path.stat()
            known = self._ended_trials.get(path)
            if known is None or known[0] != status.st_mtime_ns:
                about = decode(ReconstructionFile, path.read_bytes())
                row = WatchedRow(
                    name=about.scene,
                    status=about.status,
                    note=one_line(about.reason),
                    picture=self._name(folder / PICTURE) if (folder / PICTURE).is_file() else None,
                )
                known = self._ended_trials[path] = (status.st_mtime_ns, row)
        except (OSError, RecordError) as error:
            return 0, WatchedRow(name=folder.name, status="unreadable", note=_reason(error))
        return known

    def _running_trial(self, folder: Path) -> WatchedRow:
        unfinished = UnfinishedTrial(folder=folder, stays=True)
        begun = unfinished.read_begun()
        calls = _lines(unfinished.scene_folder / TRIAL / CALLS)
        newest = _newest_picture(folder)
        return WatchedRow(
            name=begun.scene if begun else folder.name,
            status="ending" if unfinished.read_ended() else "running",
            note=f"{begun.agent}, calls so far: {calls}" if begun else "",
            picture=self._name(folder / newest) if newest else None,
        )

    def _name(self, path: Path) -> str:
        return path.relative_to(self.top).as_posix()


def _watched_rows(rows: Iterable[RunRow]) -> tuple[WatchedRow, ...]:
    return tuple(
        WatchedRow(name=row.file_name, status=row.status, note=one_line(row.reason or ""))
        for row in islice(rows, _MOST_ROWS)
    )


def _walk(top: Path) -> Iterator[tuple[Path, set[str]]]:
    """The folders below one, itself first, with their files' names; no link is followed."""
    for folder, below, files in os.walk(top):
        here = Path(folder)
        deep = len(here.relative_to(top).parts) >= _DEEPEST
        whole = deep or not _TELLING.isdisjoint(files)
        below[:] = [] if whole else sorted(filter(_is_looked_into, below))
        yield here, {*files}


def _is_looked_into(name: str) -> bool:
    return not name.startswith(".") or name.startswith(".unfinished-")


def _newest_picture(folder: Path) -> str | None:
    """The picture that an agent wrote last into its workspace, which it may be changing."""
    found: list[tuple[int, str]] = []
    try:
        with Beneath(folder) as beneath:
            for name in beneath.names(WORKSPACE):
                if name.lower().endswith(PICTURES) and Path(name).stem != REFERENCE:
                    status = beneath.status(f"{WORKSPACE}/{name}")
                    found += [(status.st_mtime_ns, name)] if status else []
    except (OSError, RefusedFileError):
        return None
    return f"{WORKSPACE}/{max(found)[1]}" if found else None


def _first_metric(summary: Summary) -> str:
    """Such as "AP 0.5501", over all attempted images."""
    first = next(summary.metric_values())
    return f"{first.name} {Number(value=first.value)}"


def _end(path: Path, at: int) -> bytes:
    """The last bytes of a file before `at`; none before its start."""
    if not at:
        return b""
    with path.open("rb") as stream:
        stream.seek(max(0, at - _END_BYTES))
        return stream.read(min(at, _END_BYTES))


def _lines(path: Path) -> int:
    try:
        return path.read_bytes().count(b"\n")
    except OSError:
        return 0


def _reason(error: Exception) -> str:
    return one_line(str(error) if isinstance(error, LegoWorldError) else cause(error))
