"""Category names as the noun phrases that SAM 3 is asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

RULES = ("bare", "qualified")


def prompt_strings(names: Sequence[str], rule: str) -> list[str]:
    """One phrase per category name, in order.

    bare: what stands before a parenthesis, "_" as a space ("car_(automobile)" -> "car"). Where
    that would name two categories ("bow_(weapon)", "bow_(decorative_ribbons)"), both keep theirs:
    "bow (weapon)". qualified: every name keeps its parenthesis. ValueError for another rule and
    for a name that gives no phrase.
    """
    if rule not in RULES:
        raise ValueError(f"unknown prompt rule {rule!r}: {', '.join(RULES)}")
    qualified = [_spaced(name) for name in names]
    bare = [_spaced(name.partition("(")[0]) for name in names]
    times = Counter(phrase.casefold() for phrase in bare)
    phrases = [
        short if rule == "bare" and times[short.casefold()] == 1 else full
        for short, full in zip(bare, qualified, strict=True)
    ]
    if not all(phrases):
        raise ValueError("a category has an empty name")
    return phrases


def _spaced(text: str) -> str:
    return " ".join(text.replace("_", " ").split())
