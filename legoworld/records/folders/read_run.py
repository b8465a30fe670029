"""A run folder as it is read: its configuration, and the records of a run that has ended.

`describe_other_folder` says what another folder is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from legoworld.errors import ConfigurationMismatchError, cause
from legoworld.files import refused_by_machine, sha256_of_file
from legoworld.records.base import RecordError, decode, decode_lines
from legoworld.records.folders.prediction_files import prediction_files, read_image_predictions
from legoworld.records.folders.run_journal import JOURNAL
from legoworld.records.run_file import Configuration, ImageRecord, RunFile, RunHead
from legoworld.records.run_rows import RunRow

RUN: Final = "run.json"
ROWS: Final = "per_image.jsonl"
SUMMARY: Final = "summary.json"
#: What a family has of all images in one file; the files of images lie in the folder of its name.
ANSWERS: Final = "answer.json"
#: What a run that has not ended has in place of run.json.
CONFIGURATION: Final = "configuration.json"
#: The schema of run.json; 2 added `results_sha256`.
RUN_SCHEMA: Final = 2


class RunDamagedError(ConfigurationMismatchError):
    """A file of a run folder is not what a run writes."""

    code = "run_damaged"


def recorded_configuration(folder: Path) -> Configuration | None:
    """The configuration of the run in a folder, finished or not; None when there is none."""
    for name in (CONFIGURATION, RUN):
        path = folder / name
        if path.is_file():
            return _configuration_in(path)
    return None


def _configuration_in(path: Path) -> Configuration:
    try:
        data = path.read_bytes()
        if path.name == RUN:
            return decode(RunHead, data).configuration
        return decode(Configuration, data)
    except (OSError, RecordError) as error:
        if isinstance(error, OSError) and refused_by_machine(error):
            raise
        raise RunDamagedError(
            f"{path.name} in the output folder is not of a run",
            found=cause(error),
            expected="an empty folder or an earlier run",
            next_step="choose another -o, or pass --overwrite where it is a damaged run",
        ) from error


def finished_records(folder: Path) -> Iterator[ImageRecord]:
    """Records of a run that has ended, put together again from its files; none otherwise.

    By ascending image id; predictions are read as the records are taken. The images of a file that
    is gone, or is not the one the run wrote, have none.
    """
    if not (folder / RUN).is_file() or not (folder / ROWS).is_file():
        return
    document = finished_run(folder)
    rows = _rows(folder, document)
    per_file = document.configuration.images_per_file or None
    files = [f for f in prediction_files(folder, per_file, len(rows)) if f.is_file()]
    lost = list_altered(folder, document, files)
    files = [f for f in files if f.relative_to(folder).as_posix() not in lost]
    each = read_image_predictions([row.image_id for row in rows], files)
    for row, predictions in zip(rows, each, strict=True):
        scene = document.scenes.get(str(row.image_id))
        yield ImageRecord(row=row, predictions=predictions, scene=scene)


def finished_run(folder: Path) -> RunFile:
    """run.json. RunDamagedError where it is not as a run writes it."""
    try:
        return decode(RunFile, (folder / RUN).read_bytes())
    except (OSError, RecordError) as error:
        raise damaged_error(folder, RUN, error) from error


def _rows(folder: Path, document: RunFile) -> list[RunRow]:
    """The rows of a finished run by ascending image id."""
    # Beside a journal the results are being written anew, and run.json is of those before.
    if not (folder / JOURNAL).is_file():
        refuse_altered(folder, document, [folder / ROWS])
    try:
        rows = decode_lines(RunRow, (folder / ROWS).read_bytes())
        if len({row.image_id for row in rows}) != len(rows):
            raise RecordError("rows that are not one of each image")
    except (OSError, RecordError) as error:
        raise damaged_error(folder, ROWS, error) from error
    return sorted(rows, key=lambda row: row.image_id)


def damaged_error(folder: Path, name: str, error: OSError | RecordError) -> RunDamagedError:
    """What to raise for a file that cannot be read as a run writes it."""
    return RunDamagedError(
        f"{folder.name}/{name} cannot be read",
        found=cause(error),
        expected="what a finished run writes",
        next_step="run its command again with --overwrite",
    )


def refuse_altered(folder: Path, document: RunHead, files: Iterable[Path]) -> None:
    """RunDamagedError where a file is not the one that run.json, `document`, has on record."""
    for name in list_altered(folder, document, files):
        raise RunDamagedError(
            f"{folder.name}/{name} is not the one that the run wrote",
            found="another sha256",
            expected=f"the sha256 in {RUN}",
            next_step="run its command again with --overwrite",
        )


def list_altered(folder: Path, document: RunHead, files: Iterable[Path]) -> list[str]:
    """Names of the files that are there and not as run.json, `document`, has them on record.

    Depth files have their hashes in their rows. run.json of before schema 2 has none, and nothing
    is checked.
    """
    recorded = document.results_sha256
    if not recorded:
        return []
    hashed = hashes(folder, files)
    return [name for name, sha256 in hashed.items() if recorded.get(name) != sha256]


def hashes(folder: Path, files: Iterable[Path]) -> dict[str, str]:
    """The sha256 of those of a folder's files that are there, by their names in it."""
    return {
        path.relative_to(folder).as_posix(): sha256_of_file(path)
        for path in files
        if path.is_file()
    }


#: A file that one kind of folder holds, and what the folder is called; the first that is there.
_KINDS: Final = (
    ("comparison.json", "a comparison"),
    ("evidence.json", "an evaluation"),
    ("run.json", "a run"),
    ("configuration.json", "a run that has not ended"),
    ("leaderboard.json", "a table of the bench"),
    ("trajectories.json", "a folder of `legoworld trajectory score`"),
    ("private/truth.json", "a dataset of the bench"),
    ("ledger.jsonl", "a ledger of the plugin"),
    ("scene.blend", "a scene folder"),
    ("scene.glb", "a scene folder"),
)


def describe_other_folder(folder: Path, wanted: str) -> str | None:
    """Such as "evals/a is an evaluation, not a run"; None for a folder of no known kind.

    wanted: the kind that is needed, as in this module; a folder of that kind gives None, too.
    """
    kind = _kind(folder)
    if kind is not None:
        return None if kind.startswith(wanted) else f"{folder} is {kind}, not {wanted}"
    below = sorted(path for path in folder.glob("*/") if _kind(path) is not None)
    if not below:
        return None
    return f"{folder} is not {wanted}: it holds {below[0]}, which is {_kind(below[0])}"


def _kind(folder: Path) -> str | None:
    return next((kind for name, kind in _KINDS if (folder / name).is_file()), None)
