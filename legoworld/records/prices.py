"""A price card: what models cost a token, as their makers published it on a day."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from legoworld.records.base import Record

_Price = Annotated[float, Meta(ge=0)]


class ModelPrice(Record, frozen=True, kw_only=True):
    """[[model]]: one price in US dollars a million tokens.

    names: as transcripts and --model have them; source: the page it is from. Only for models whose
    price does not depend on the length of a request: a trial's totals do not tell that.
    """

    names: Annotated[tuple[str, ...], Meta(min_length=1)]
    source: str
    input_usd: _Price
    cached_input_usd: _Price
    output_usd: _Price


class PriceCardFile(Record, frozen=True, kw_only=True):
    """prices.toml. date: when the sources were read."""

    title: str
    date: Annotated[str, Meta(pattern=r"^\d{4}-\d{2}-\d{2}$")]
    model: tuple[ModelPrice, ...] = ()
