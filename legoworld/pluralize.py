"""Numbers and names in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath


def plural(count: int, one: str, many: str) -> str:
    """A number with its noun in the right form: "1 box", "0 boxes"."""
    return f"{count:,} {word_for(count, one, many)}"


def word_for(count: int, one: str, many: str) -> str:
    """The singular or plural form that fits a number."""
    return one if count == 1 else many


def share(part: int, total: int, one: str, many: str) -> str:
    """A fraction with its noun: "1 of 1 box", "0 of 12 boxes"."""
    return f"{part:,} of {plural(total, one, many)}"


def first_few(names: Sequence[str], most: int) -> str:
    """The first names, and how many more there are: "a, b and 3 more"."""
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def nearest_names(word: str, known: Iterable[str], n: int = 3, cutoff: float = 0.6) -> list[str]:
    """The known names most similar to a word, at most n; the nearest first."""
    import difflib  # only needed for a message

    return difflib.get_close_matches(word, [*known], n, cutoff)


def did_you_mean(word: str, known: Sequence[str]) -> str:
    """A sentence that suggests the nearest known word, after a space; empty without one."""
    near = nearest_names(word.casefold(), known, 1)
    return f" Did you mean {near[0]!r}?" if near else ""


def in_another_folder(name: str, known: Iterable[str]) -> str | None:
    """The first known path with the same file name in another folder, or None."""
    base = PurePosixPath(name.replace("\\", "/")).name
    others = (other for other in known if other != name)
    return next((other for other in others if PurePosixPath(other).name == base), None)
