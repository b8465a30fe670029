"""What a folder is, in words: for the error of a command that was given one of another kind."""

from __future__ import annotations

from pathlib import Path
from typing import Final

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


def folder_of_other_kind(folder: Path, wanted: str) -> str | None:
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
