"""What costs a side most: its errors by kind and category, by what mending them gains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from legoworld.pluralize import plural
from legoworld.records.report_tables import Cost, SideCosts
from legoworld.report.mended_ap import ErrorKey, MendedAp

#: How many are named of one side, and of each where there are several.
_MOST, _MOST_OF_EACH = 4, 3
#: A gain of AP that rounds to nothing is none.
_LEAST: Final = 0.0005
_FAILED: Final = "failed"
#: An error of a kind, in words; {0} is the category.
_WORDS: Final = {
    "classification": "{0}: taken for another category",
    "localisation": "{0}: overlaps too little",
    "both": "{0}: wrong category and place",
    "duplicate": "{0}: an object predicted twice",
    "background": "{0}: nothing annotated there",
    "missed": "{0} missed",
}


def side_costs(sides: Sequence[MendedAp], names: Mapping[int, str]) -> tuple[SideCosts, ...]:
    """The most costly errors of every side; of two, those that tell it from the other."""
    made = [of_side.costs() for of_side in sides]
    shown = []
    for at, (of_side, costs) in enumerate(zip(sides, made, strict=True)):
        other = made[1 - at].gain if len(sides) == 2 else None
        most = _costs(of_side, costs.gain, other, names)
        failed = _failed(of_side, costs.ap, costs.ap_scored)
        n_most = _MOST_OF_EACH if len(sides) > 1 else _MOST
        shown.append(
            SideCosts(
                label=of_side.side.name,
                n=sum(len(places) for places in of_side.found.values()),
                most=(*failed, *most[:n_most]),
            )
        )
    return tuple(shown)


def _failed(of_side: MendedAp, ap: float | None, ap_scored: float | None) -> Iterator[Cost]:
    """The images without an answer, where there are other ones: they come first."""
    failed, attempted = len(of_side.failed), of_side.side.summary.coverage.attempted
    if not failed or ap is None or ap_scored is None:
        return
    noun = "scene" if of_side.side.is_scene else "answer"
    have = "has one" if attempted - failed == 1 else "have one"
    yield Cost(
        kind=_FAILED,
        category=None,
        n=failed,
        images=failed,
        text=f"{failed} of {plural(attempted, 'image', 'images')} without {noun}: "
        f"AP {ap_scored:.3f} over the {attempted - failed} that {have}",
        gain=ap_scored - ap,
        others=None,
    )


def _costs(
    of_side: MendedAp,
    gain: Mapping[ErrorKey, float],
    other: Mapping[ErrorKey, float] | None,
    names: Mapping[int, str],
) -> list[Cost]:
    def ahead(key: ErrorKey) -> float:
        return gain[key] - (other.get(key, 0.0) if other is not None else 0.0)

    ordered = sorted(
        (key for key in gain if gain[key] >= _LEAST and ahead(key) > 0),
        key=lambda key: (-ahead(key), -gain[key], key),
    )
    return [
        Cost(
            kind=key[0],
            category=key[1],
            n=len(of_side.found[key]),
            images=len(set(of_side.found[key])),
            text=_WORDS[key[0]].format(names[key[1]]),
            gain=gain[key],
            others=None if other is None else other.get(key, 0.0),
        )
        for key in ordered
    ]
