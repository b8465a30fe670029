"""Recorded judgements of bench submissions, and how far judges agree with the scores."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from legoworld.conventions import SCHEMA_VERSION
from legoworld.records.base import Record

Aspect = Literal["reconstruction", "appearance"]
Text = Annotated[str, Meta(min_length=1)]


class Judgement(Record, frozen=True, kw_only=True):
    """One line: a judge saw two submissions of one builder and chose.

    item: what is compared, the same in both orders; shown: the two submissions in the order shown;
    chosen: one of them, null for a tie; better: the one that the score prefers.
    """

    builder: Text
    judge: Text
    aspect: Aspect
    item: Text
    shown: tuple[Text, Text]
    chosen: str | None
    better: Text


class Agreement(Record, frozen=True, kw_only=True):
    """Judgements that chose what the score prefers; a tie agrees with neither."""

    agreed: int
    n: int
    share: float


class OrderSwaps(Record, frozen=True, kw_only=True):
    """Items that a judge saw in both orders. first_share: of all its judgements, the first shown.

    share: consistent over swapped, null without any.
    """

    swapped: int
    consistent: int
    share: float | None
    first_share: float


class AspectAgreement(Record, frozen=True, kw_only=True):
    """matrix: builder -> judge -> agreement. Means are over cells, each weighted alike.

    self_mean: judges of their own builds; cross_mean: of others'; null where there is no such cell.
    self_above_others: builders whose own judge agrees more than the mean of the others;
    builders: how many of them have both.
    """

    matrix: dict[str, dict[str, Agreement]]
    self_mean: float | None
    cross_mean: float | None
    self_above_others: int
    builders: int
    order_swaps: dict[str, OrderSwaps]


class JudgesFile(Record, frozen=True, kw_only=True):
    """judges.json. aspects: by their names, those that were judged."""

    schema_version: int = SCHEMA_VERSION
    judgements_sha256: str
    judgements: int
    aspects: dict[str, AspectAgreement]
