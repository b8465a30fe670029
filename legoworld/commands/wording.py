"""Numbers in sentences."""

from __future__ import annotations


def counted(count: int, one: str, many: str) -> str:
    """A number with the words that go with it: "1 box", "0 boxes"."""
    return f"{count:,} {one if count == 1 else many}"


def outside_the_vocabulary(label: str, count: int, nearest: list[str]) -> str:
    """The line about a label that names no category: on how many owners, and what it is like."""
    near = f"; near: {', '.join(nearest)}" if nearest else ""
    return f"label {label!r} is not in the vocabulary ({counted(count, 'owner', 'owners')}){near}"
