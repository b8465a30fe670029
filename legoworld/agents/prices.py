"""What a trial cost, by a price card: where its transcript tells tokens and no cost."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.cards import read_toml
from legoworld.errors import CatalogError
from legoworld.files import sha256_of_file
from legoworld.records.agents import ModelPrice, PriceCardFile, Usage
from legoworld.records.atif import AtifFinalMetrics, AtifTrajectory
from legoworld.trajectories.transcripts import total_usage

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
    price = prices.find_price(model)
    if (
        price is None
        or not isinstance(total, AtifFinalMetrics)
        or _names_another(trajectory, model)
    ):
        return usage
    counts = (total.total_prompt_tokens, total.total_cached_tokens, total.total_completion_tokens)
    prompt, cached, completion = counts
    if not (isinstance(prompt, int) and isinstance(cached, int) and isinstance(completion, int)):
        return usage
    cost = price.cost_usd(prompt, cached, completion)
    return replace(usage, cost_usd=round(cost, 6), cost_source=prices.source)


def with_cost(trajectory: AtifTrajectory, usage: Usage) -> AtifTrajectory:
    """The trajectory with a cost by a card among its totals, marked as such."""
    total = trajectory.final_metrics
    if usage.cost_source in (None, "transcript") or not isinstance(total, AtifFinalMetrics):
        return trajectory
    extra = {
        **(total.extra if isinstance(total.extra, dict) else {}),
        "legoworld": {"cost_source": usage.cost_source},
    }
    return replace(
        trajectory,
        final_metrics=replace(total, total_cost_usd=usage.cost_usd, extra=extra),
    )


def _names_another(trajectory: AtifTrajectory, model: str | None) -> bool:
    """Whether a step was made by another model: the totals then hold both."""
    named = {step.model_name for step in trajectory.steps if isinstance(step.model_name, str)}
    return bool(named - {model})
