"""Sentences printed by more than one command."""

from __future__ import annotations

from legoworld.pluralize import plural


def outside_the_vocabulary(label: str, count: int, nearest: list[str]) -> str:
    """The line about a label outside the vocabulary: how many owners, and similar categories."""
    near = f"; near: {', '.join(nearest)}" if nearest else ""
    return f"label {label!r} is not in the vocabulary ({plural(count, 'owner', 'owners')}){near}"
