"""What a later tier hides of an earlier one: tiers nest in the scene, not in a picture of it."""

from __future__ import annotations

from collections.abc import Sequence

from legoworld.bench.family import MadeCase


def hidden_things(cases: Sequence[MadeCase]) -> dict[str, tuple[str, ...]]:
    """Objects that an earlier tier of the view scores and this case does not, by file name.

    cases: of one family, tiers from easy to hard. Cases without such objects are left out.
    """
    seen: dict[int, set[str]] = {}
    hidden = {}
    for case in cases:
        now = {one.name for one in case.truth.scored}
        earlier = seen.setdefault(case.view, set())
        if earlier - now:
            hidden[case.file_name] = tuple(sorted(earlier - now))
        earlier |= now
    return hidden
