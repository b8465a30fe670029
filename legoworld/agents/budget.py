"""What a trial may spend besides its time: calls, tokens, dollars; it is ended where that is spent.

Calls are counted by the endpoint, which answers none above the budget. Tokens and dollars are read
off the agent's transcript while it writes it: the request that passes the budget is the last one.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from legoworld.agents.agent_cards import AgentCard
from legoworld.agents.prices import PriceCard
from legoworld.errors import UsageError
from legoworld.records.agents import UNLIMITED, Budget, OverBudget, TranscriptFormat, Usage
from legoworld.trajectories.transcripts import read_transcript, total_usage

#: Transcripts that count each request as it ends; the others count at their end alone.
_COUNTING: Final[tuple[TranscriptFormat, ...]] = ("claude", "opencode", "atif")
_LOOK_EVERY_S: Final = 0.5


def plan_budget(card: AgentCard, asked: Budget) -> Budget:
    """The budget of a run's trials: what is asked for, else the card's.

    UsageError for tokens or dollars of an agent that counts them only when it has ended.
    """
    own = card.about.budget
    budget = Budget(
        calls=asked.calls or own.calls,
        tokens=asked.tokens or own.tokens,
        cost_usd=asked.cost_usd or own.cost_usd,
    )
    kind = card.about.transcript.format
    if (budget.tokens or budget.cost_usd) and kind not in _COUNTING:
        raise UsageError(
            f"the agent {card.name} cannot be held to a budget of tokens",
            found=f"its transcript ({kind}) counts them when it has ended",
            expected="a budget of calls or time, or an agent that counts each request",
            next_step="leave --max-tokens and --max-cost out",
        )
    return budget


def used_tokens(usage: Usage) -> int | None:
    """All tokens of a trial so far, cached ones included; None where none are counted."""
    counts = [n for n in (usage.prompt_tokens, usage.completion_tokens) if n is not None]
    return sum(counts) if counts else None


def read_usage(
    paths: Sequence[Path], kind: TranscriptFormat, model: str | None, prices: PriceCard
) -> Usage:
    """What the parts of an unfinished transcript count, and its cost by the price card."""
    parts = [
        total_usage(read_transcript(path, kind, agent="", version="", prompt="")) for path in paths
    ]

    def summed(name: str) -> int | None:
        counts = [n for part in parts if (n := getattr(part, name)) is not None]
        return sum(counts) if counts else None

    prompt, cached = summed("prompt_tokens"), summed("cached_tokens")
    completion, price = summed("completion_tokens"), prices.find_price(model)
    costs = [part.cost_usd for part in parts if part.cost_usd is not None]
    by_card = price.cost_usd(prompt or 0, cached or 0, completion or 0) if price else None
    return Usage(
        prompt_tokens=prompt,
        cached_tokens=cached,
        completion_tokens=completion,
        cost_usd=sum(costs) if costs else by_card,
    )


class BudgetWatch:
    """Ends an agent where its budget is spent, and remembers which part of it was.

    refused: whether a call above the budget was asked for; usage: what was used so far, by the
    transcript or by a proxy that counts requests.
    """

    def __init__(
        self, budget: Budget, refused: Callable[[], bool], usage: Callable[[], Usage]
    ) -> None:
        self.over: OverBudget | None = None
        self._budget, self._refused, self._usage = budget, refused, usage
        self._done = threading.Event()

    @contextmanager
    def ends(self, end: Callable[[], None]) -> Iterator[None]:
        """Call `end` when the budget is spent during the block."""
        looking = threading.Thread(target=self._look, args=(end,), daemon=True)
        if self._budget != UNLIMITED:
            looking.start()
        try:
            yield
        finally:
            self._done.set()
            if looking.is_alive():
                looking.join()

    def _look(self, end: Callable[[], None]) -> None:
        pause = _LOOK_EVERY_S
        while self.over is None and not self._done.wait(pause):
            began = time.thread_time()
            self.over = self._spent()
            # Reading a long transcript takes time: at most a twentieth of it.
            pause = max(_LOOK_EVERY_S, 20 * (time.thread_time() - began))
        if self.over is not None:
            end()

    def _spent(self) -> OverBudget | None:
        if self._refused():
            return "calls"
        tokens, cost_usd = self._budget.tokens, self._budget.cost_usd
        used = self._usage() if tokens or cost_usd else Usage()
        if tokens and (used_tokens(used) or 0) >= tokens:
            return "tokens"
        return "cost" if cost_usd and (used.cost_usd or 0.0) >= cost_usd else None
