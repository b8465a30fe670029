"""Checks of what is on record: hashes of files and inputs, and values that must be equal."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TypeVar

from legoworld.errors import LegoWorldError, one_line
from legoworld.files import Json
from legoworld.records.evaluation import AnyEvidence
from legoworld.records.folders.evaluation_folder import excluded_keys, hash_and_size
from legoworld.records.folders.read_evaluation import EVIDENCE

T = TypeVar("T")


@dataclass(frozen=True)
class Check:
    """One thing looked at. status: ok, CHANGED, MISSING, UNLISTED or DIFFERS."""

    status: str
    what: str
    found: str


def until_damage(checks: Iterator[Check]) -> Iterator[Check]:
    """Checks of numbers; what is not even numbers ends them as a difference."""
    try:
        yield from checks
    except LegoWorldError as error:
        yield Check("DIFFERS", "the numbers made again", one_line(str(error), 100))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        problem = one_line(f"{type(error).__name__}: {error}", 100)
        yield Check("DIFFERS", EVIDENCE, f"the numbers cannot be made again: {problem}")


def check_files(folder: Path, evidence: AnyEvidence) -> Iterator[Check]:
    """Every file of a folder against the hashes in its evidence."""
    for name, sha256 in evidence.files.items():
        yield _check_hash(f"file {name}", folder / name, sha256)
    present = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    for name in sorted(present - set(evidence.files) - {EVIDENCE}):
        yield Check("UNLISTED", f"file {name}", f"not in {EVIDENCE}")


def check_inputs(folder: Path, evidence: AnyEvidence, root: Path | None) -> Iterator[Check]:
    """Every input against its hash; looked for below `root` where given."""
    for entry in evidence.inputs:
        what, without = f"input {entry.role} {entry.path}", entry.without or ()
        allowed = excluded_keys(entry.role)
        # Evidence of before the time was left out leaves nothing out.
        if without in ((), allowed):
            yield _check_hash(what, find_input(folder, entry.path, root), entry.sha256, without)
        else:
            may = ", ".join(allowed) or "nothing"
            yield Check("DIFFERS", what, f"its hash leaves out {[*without]!r:.60}; may: {may}")


def find_input(folder: Path, recorded: str, root: Path | None) -> Path | None:
    """An input's path: as recorded, or the longest ending of it that lies below root."""
    if root is None:
        return folder / recorded
    parts = [part for part in PurePosixPath(recorded).parts if part != ".."]
    for start in range(len(parts)):
        candidate = root.joinpath(*parts[start:])
        if candidate.is_file():
            return candidate
    return None


def find_closest(places: Iterable[Path], find: Callable[[Path], T | None]) -> T:
    """What is found at the first place that has it; where none has, the first place's error."""
    refusal: LegoWorldError | None = None
    for place in places:
        try:
            if (found := find(place)) is not None:
                return found
        except LegoWorldError as error:
            refusal = refusal or error
    assert refusal is not None
    raise refusal


def _check_hash(what: str, path: Path | None, sha256: str, without: Sequence[str] = ()) -> Check:
    if path is None or not path.is_file():
        return Check("MISSING", what, "no such file")
    try:
        digest, _ = hash_and_size(path, without)
    except (ValueError, RecursionError):
        return Check("CHANGED", what, f"not JSON, on record {sha256[:12]}")
    if digest != sha256:
        return Check("CHANGED", what, f"{digest[:12]}, on record {sha256[:12]}")
    return Check("ok", what, digest[:12])


def check_equal(what: str, found: Json, recorded: Json) -> Check:
    """What was found against what is on record."""
    if found == recorded:
        return Check("ok", what, str(found)[:60])
    return Check("DIFFERS", what, f"{str(found)[:60]}, on record {str(recorded)[:60]}")


def refuse_unseen(sizes_bytes: Mapping[Path, int], what: str, error: type[LegoWorldError]) -> None:
    """Raise the error where this machine does not see files as the command does, by their sizes."""
    for path, size_bytes in sizes_bytes.items():
        size = path.stat().st_size if path.is_file() else None
        if size != size_bytes:
            raise error(
                f"a machine does not see {what}",
                found=f"{'nothing' if size is None else f'{size} bytes'} at {path} "
                f"on {platform.node()}",
                expected=f"the {size_bytes} bytes that the command sees there",
                next_step="put RUN and --truth into folders that all machines see under the same "
                "path, or use --engine local",
            )
