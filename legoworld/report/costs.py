"""What costs a side most: each finding is mended alone, and its family's metric made again.

A family says what its findings are and what mending each gains, by its own official accumulation;
their order, and what of them the first screen names, is decided here for all families.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from legoworld.evaluation.stored import StoredEvaluation
from legoworld.pluralize import plural
from legoworld.records.report_tables import Cost, SideCosts

#: How many are named of one side, and of each where there are several.
_MOST, _MOST_OF_EACH = 4, 3
#: A kind and what it is told of, the same for both sides: a category, a photo and an object of it.
Key = tuple[str, int | str]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Errors that one change would mend. gain: how much better the metric is with it.

    images: of each error; category, kind_filter: the filters that list their photos in the page;
    without either the first image is where the finding leads.
    """

    text: str
    gain: float
    images: Sequence[int]
    category: int | None = None
    kind_filter: str = ""


@dataclass(frozen=True, kw_only=True)
class Findings:
    """One side's metric and its findings. over: what the metric is a mean of.

    value, value_answered: over all attempted images and over those with an answer, which `n_failed`
    do not have; missing: how a failed one counts; errors: how many there are in all; least: a
    smaller gain is none; sign: -1 where lower is better.
    """

    side: StoredEvaluation
    metric: str
    over: str
    by_error: Mapping[Key, Finding]
    n_attempted: int
    n_failed: int
    value: float | None
    value_answered: float | None
    missing: str = ""
    noun: str = ""
    images: str = "image"
    errors: str = ""
    least: float = 0.0005
    sign: int = 1


def side_costs(sides: Sequence[Findings]) -> tuple[SideCosts, ...]:
    """The most costly findings of every side; of two, those that tell it from the other."""
    shown = []
    for at, side in enumerate(sides):
        other = sides[1 - at].by_error if len(sides) == 2 else None
        most = _costs(side, other, at)[: _MOST_OF_EACH if len(sides) > 1 else _MOST]
        shown.append(
            SideCosts(
                label=side.side.name,
                metric=side.metric,
                over=f"Each mended alone: {side.metric} over {side.over}{side.errors}",
                most=(*_failed_cost(side, at), *most),
            )
        )
    return tuple(shown)


def _failed_cost(side: Findings, of: int) -> Iterator[Cost]:
    """The images without an answer, where there are other ones: they come first."""
    have = side.n_attempted - side.n_failed
    if not side.n_failed or side.value is None or side.value_answered is None:
        return
    noun = side.noun or ("scene" if side.side.is_scene else "answer")
    yield Cost(
        kind="failed",
        link=f"?tab=photos&kind=failed&of={of}",
        n=side.n_failed,
        images=side.n_failed,
        text=f"{side.n_failed} of {plural(side.n_attempted, side.images, f'{side.images}s')} "
        f"without {noun}{side.missing}: {side.metric} {side.value:.3f}, over the {have} with one "
        f"{side.value_answered:.3f}",
        gain=side.value_answered - side.value,
        others=None,
    )


def _costs(side: Findings, other: Mapping[Key, Finding] | None, of: int) -> list[Cost]:
    def other_gain(key: Key) -> float:
        return other[key].gain if other and key in other else 0.0

    findings = side.by_error
    ordered = sorted(
        (k for k, f in findings.items() if f.gain >= side.least and f.gain > other_gain(k)),
        key=lambda k: (other_gain(k) - findings[k].gain, -findings[k].gain, str(k)),
    )
    return [
        Cost(
            kind=key[0],
            link=_link(findings[key], of),
            n=len(findings[key].images),
            images=len(set(findings[key].images)),
            text=findings[key].text,
            gain=side.sign * findings[key].gain,
            others=None if other is None else side.sign * other_gain(key),
        )
        for key in ordered
    ]


def _link(finding: Finding, of: int) -> str:
    """The list of its photos, or the photo itself."""
    kind = f"&kind={finding.kind_filter}" if finding.kind_filter else ""
    if finding.category is None and not kind:
        return f"/{finding.images[0]}"
    category = f"&cat={finding.category}" if finding.category is not None else ""
    return f"?tab=photos{kind}{category}&of={of}"
