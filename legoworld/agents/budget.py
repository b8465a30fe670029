"""What a trial may spend besides its time: calls, tokens, dollars; it is ended where that is spent.

Calls are counted by the endpoint, which answers none above the budget. Tokens and dollars are those
of recorded requests, or are read off the agent's transcript while it writes it: the request that
passes the budget is the last one.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.agents.agent_cards import AgentCard
from legoworld.agents.prices import PriceCard, least_cost_usd, recorded_usage
from legoworld.errors import LegoWorldError, UsageError, cause
from legoworld.records.agents import (
    UNLIMITED,
    ApiRequest,
    Budget,
    OverBudget,
    TranscriptFormat,
    Usage,
)
from legoworld.records.base import as_json
from legoworld.trajectories.transcripts import join_trajectories, read_transcript, total_usage

#: Transcripts that count each request as it ends; the others count at their end alone.
_COUNTING: Final[tuple[TranscriptFormat, ...]] = ("claude", "opencode", "atif")
_LOOK_EVERY_S: Final = 0.5


def plan_budget(card: AgentCard, asked: Budget, *, record: bool = False) -> Budget:
    """The budget of a run's trials: what is asked for, else the card's.

    record: whether requests are counted as they are made. Without it UsageError for tokens or
    dollars of an agent that counts them only when it has ended.
    """
    asked_for = {key: value for key, value in as_json(asked).items() if value is not None}
    budget = replace(card.about.budget, **asked_for)
    kind = card.about.transcript.format
    if (budget.tokens or budget.cost_usd) and not record and kind not in _COUNTING:
        raise UsageError(
            f"the agent {card.name} cannot be held to a budget of tokens",
            found=f"its transcript ({kind}) counts them when it has ended",
            expected="a budget of calls or time, or an agent that counts each request",
            next_step="add --record, or leave --max-tokens and --max-cost out",
        )
    return budget


def used_tokens(usage: Usage) -> int | None:
    """All tokens of a trial so far, cached ones included; None where none are counted."""
    counts = [n for n in (usage.prompt_tokens, usage.completion_tokens) if n is not None]
    return sum(counts) if counts else None


def unheld(budget: Budget, used: Usage) -> tuple[str, ...]:
    """What of a budget could not be held to, since nothing counts it."""
    unknown = {
        "tokens": budget.tokens is not None and not used_tokens(used),
        "dollars": budget.cost_usd is not None and used.cost_usd is None,
    }
    return tuple(
        f"the budget was not held to: no {name} are known" for name in unknown if unknown[name]
    )


def read_usage(
    paths: Sequence[Path], kind: TranscriptFormat, model: str | None, prices: PriceCard
) -> Usage:
    """What the parts of an unfinished transcript count, and its cost by the price card."""
    parts = [read_transcript(path, kind, agent="", version="", prompt="") for path in paths]
    usage, price = total_usage(join_trajectories(parts)), prices.find_price(model)
    if price is None or usage.cost_usd is not None:
        return usage
    counts = (usage.prompt_tokens, usage.cached_tokens, usage.completion_tokens)
    return replace(usage, cost_usd=price.cost_usd(*(n or 0 for n in counts)))


def recorded_so_far(requests: Sequence[ApiRequest], stated: Usage, prices: PriceCard) -> Usage:
    """What recorded requests have used. stated: by the transcript.

    A request that was not counted, or whose model is not on the card, ends no budget of dollars:
    the others have cost at least so much, or what the transcript states.
    """
    used = recorded_usage(requests, prices, stated)
    least = least_cost_usd(requests, prices)
    return replace(used, cost_usd=max(used.cost_usd or 0.0, least))


class BudgetNotWatchedError(LegoWorldError):
    """What a trial has used cannot be read any more: it would spend without an end."""

    code = "budget_not_watched"


class BudgetWatch:
    """Ends an agent where its budget is spent, and remembers which part of it was.

    refused: whether a call above the budget was asked for; usage: what was used so far, by the
    transcript or by a proxy that counts requests.
    """

    def __init__(
        self, budget: Budget, refused: Callable[[], bool], usage: Callable[[], Usage]
    ) -> None:
        self.over: OverBudget | None = None
        self._budget, self._has_refusals, self._usage = budget, refused, usage
        self._end_event = threading.Event()
        self._error: Exception | None = None

    @contextmanager
    def ends(self, end: Callable[[], None]) -> Iterator[None]:
        """Call `end` when the budget is spent during the block, or cannot be watched.

        BudgetNotWatchedError at the end of the block for the latter.
        """
        looking = threading.Thread(target=self._look, args=(end,), daemon=True)
        looking.start()
        try:
            yield
        finally:
            self._end_event.set()
            looking.join()
        if self._error is not None:
            raise BudgetNotWatchedError(
                "the budget cannot be watched, and the agent was ended",
                found=f"{type(self._error).__name__}: {cause(self._error)}",
                expected="a readable transcript, or rows of recorded requests",
                next_step="run the command again to resume; without --max-tokens and --max-cost "
                "nothing is watched",
            ) from self._error

    def _look(self, end: Callable[[], None]) -> None:
        pause = _LOOK_EVERY_S
        while self._budget != UNLIMITED and not self._end_event.wait(pause):
            began = time.thread_time()
            try:
                self.over = self._exceeded_limit()
            except Exception as error:  # noqa: BLE001  raised by `ends`, in the trial's thread
                self._error = error
            if self.over is not None or self._error is not None:
                end()
                return
            # Reading a long transcript takes time: at most a twentieth of it.
            pause = max(_LOOK_EVERY_S, 20 * (time.thread_time() - began))

    def _exceeded_limit(self) -> OverBudget | None:
        if self._has_refusals():
            return "calls"
        tokens, cost_usd = self._budget.tokens, self._budget.cost_usd
        used = self._usage() if tokens or cost_usd else Usage()
        if tokens and (used_tokens(used) or 0) >= tokens:
            return "tokens"
        return "cost" if cost_usd and (used.cost_usd or 0.0) >= cost_usd else None
