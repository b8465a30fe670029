"""Numbers in sentences."""

from __future__ import annotations


def counted(count: int, one: str, many: str) -> str:
    """A number with the words that go with it: "1 box", "0 boxes"."""
    return f"{count:,} {one if count == 1 else many}"
