"""What a trial cost, by a price card: where its transcript tells tokens and no cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace

from legoworld.cards import read_toml
from legoworld.errors import CatalogError
from legoworld.files import sha256_of_file
from legoworld.records.agents import ApiRequest, ModelPrice, PriceCardFile, Usage
from legoworld.records.atif import AtifFinalMetrics, AtifTrajectory
from legoworld.records.base import UnsetType
from legoworld.trajectories.transcripts import total_usage

_Count = int | UnsetType | None
PRICES: Final = Path(__file__).with_name("prices.toml")


@dataclass(frozen=True, kw_only=True)
class PriceCard:
    """A card, and the hash of its file."""

    about: PriceCardFile
    sha256: str

    @property
    def source(self) -> str:
        """The label of costs computed with this card."""
        return f"prices of {self.about.date}, {self.sha256[:12]}"

    def find_price(self, model: str | None) -> ModelPrice | None:
        """The price of a model by exactly this name; None where the card has none."""
        return next((price for price in self.about.model if model in price.names), None)


def read_prices(path: Path | None) -> PriceCard:
    """A price card; without a path the one that is shipped. CatalogError says what is wrong."""
    path = path or PRICES
    about = read_toml(
        PriceCardFile,
        path,
        what=f"the price card {path.name}",
        expected="a card such as legoworld/agents/prices.toml",
        next_step="docs/agents.md says what a price card holds",
    )
    names = [name for price in about.model for name in price.names]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise CatalogError(
            f"the price card {path.name} has two prices for a model",
            found=", ".join(twice),
            expected="one price for each name",
        )
    return PriceCard(about=about, sha256=sha256_of_file(path))


def compute_usage(trajectory: AtifTrajectory, model: str | None, prices: PriceCard) -> Usage:
    """Tokens and cost of a trajectory.

    The cost is the transcript's own where it states one. Else it is by the card, where the card has
    the model and the transcript states the tokens of the whole trial; null otherwise: of a trial
    that was ended they are not known.
    """
    usage = total_usage(trajectory)
    if usage.cost_usd is not None:
        return replace(usage, cost_source="transcript")
    total = trajectory.final_metrics
    if not isinstance(total, AtifFinalMetrics) or _names_another(trajectory, model):
        return usage
    counts = (total.total_prompt_tokens, total.total_cached_tokens, total.total_completion_tokens)
    return _add_cost(usage, prices, [(model, *counts)])


def recorded_usage(requests: Sequence[ApiRequest], prices: PriceCard, stated: Usage) -> Usage:
    """Tokens of recorded requests, and their cost by the card.

    The cost is the one that the transcript stated where a request was not counted or the card lacks
    a model.
    """
    spent = [row for row in requests if row.spent]
    usage = replace(
        stated,
        prompt_tokens=sum(row.prompt_tokens or 0 for row in spent),
        cached_tokens=sum(row.cached_tokens or 0 for row in spent),
        completion_tokens=sum(row.completion_tokens or 0 for row in spent),
        tokens_source="recorded",
        requests=len(requests),
        uncounted=sum(row.uncounted for row in requests),
    )
    return _add_cost(
        usage, prices,
        [(r.model, r.prompt_tokens, r.cached_tokens, r.completion_tokens) for r in spent],
    )  # fmt: skip


def least_cost_usd(requests: Sequence[ApiRequest], prices: PriceCard) -> float:
    """What recorded requests cost at least: tokens that are known, of models on the card."""
    return sum(
        price.cost_usd(row.prompt_tokens or 0, row.cached_tokens or 0, row.completion_tokens or 0)
        for row in requests
        if row.spent and (price := prices.find_price(row.model)) is not None
    )


def _add_cost(
    usage: Usage, prices: PriceCard, uses: Sequence[tuple[str | None, _Count, _Count, _Count]]
) -> Usage:
    """The usage with the cost of what each model used, if the card and the counts have it all."""
    cost = 0.0
    for model, prompt, cached, completion in uses:
        price = prices.find_price(model)
        counts = [count for count in (prompt, cached, completion) if isinstance(count, int)]
        if price is None or len(counts) < 3:
            return usage
        cost += price.cost_usd(*counts)
    return replace(usage, cost_usd=round(cost, 6), cost_source=prices.source) if uses else usage


def with_usage(trajectory: AtifTrajectory, usage: Usage) -> AtifTrajectory:
    """The trajectory with recorded tokens and a cost by a card among its totals, marked as such."""
    total = trajectory.final_metrics
    total = total if isinstance(total, AtifFinalMetrics) else AtifFinalMetrics()
    ours: dict[str, Any] = {}
    if usage.tokens_source is not None:
        ours["tokens_source"] = usage.tokens_source
    if usage.tokens_source == "recorded":
        ours |= {"requests": usage.requests, "uncounted": usage.uncounted}
        total = replace(
            total,
            total_prompt_tokens=usage.prompt_tokens,
            total_cached_tokens=usage.cached_tokens,
            total_completion_tokens=usage.completion_tokens,
        )
    if usage.cost_source not in (None, "transcript"):
        ours["cost_source"] = usage.cost_source
        total = replace(total, total_cost_usd=usage.cost_usd)
    if not ours:
        return trajectory
    extra = {**(total.extra if isinstance(total.extra, dict) else {}), "legoworld": ours}
    return replace(trajectory, final_metrics=replace(total, extra=extra))


def _names_another(trajectory: AtifTrajectory, model: str | None) -> bool:
    """Whether a step was made by another model: the totals then hold both."""
    named = {step.model_name for step in trajectory.steps if isinstance(step.model_name, str)}
    return bool(named - {model})
