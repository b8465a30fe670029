"""Numbers and names in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath


def counted(count: int, one: str, many: str) -> str:
    """A number with the words that go with it: "1 box", "0 boxes"."""
    return f"{count:,} {word_for(count, one, many)}"


def word_for(count: int, one: str, many: str) -> str:
    """The noun or verb that goes with a number."""
    return one if count == 1 else many


def share(part: int, total: int, one: str, many: str) -> str:
    """A part of a number of things: "1 of 1 box", "0 of 12 boxes"."""
    return f"{part:,} of {counted(total, one, many)}"


def did_you_mean(word: str, known: Sequence[str]) -> str:
    """The sentence that names the nearest of the known words, after a space; empty without one."""
    import difflib  # only needed for a message

    near = difflib.get_close_matches(word.casefold(), known, n=1, cutoff=0.6)
    return f" Did you mean {near[0]!r}?" if near else ""


def in_another_folder(name: str, known: Iterable[str]) -> str | None:
    """The first of the known file names that is this one in another folder; None without one."""
    base = PurePosixPath(name.replace("\\", "/")).name
    others = (other for other in known if other != name)
    return next((other for other in others if PurePosixPath(other).name == base), None)
